"""Metrics of methods that answer on the way, and of methods that have no answer."""

from __future__ import annotations

import numpy as np
import pytest

from scenarios.evaluation import COST, DEFINITIONS, evaluate, to_metrics
from scenarios.evaluation.trajectory import online_metrics
from slam.recording import Laser, Recording
from stitch.mapping.estimate import Estimate, NoEstimate, OnlineResult


def test_latency_in_milliseconds_and_error_after_alignment():
    truth = np.column_stack([np.arange(100.0), np.zeros(100), np.zeros(100)])
    poses = truth + np.array([0.0, 7.0, 0.0])
    poses[:, 1] += np.where(np.arange(100) % 2, 0.1, -0.1)
    seconds = np.full(100, 0.002)
    seconds[10] = 0.5
    found = {m.name: m for m in to_metrics("x", online_metrics(OnlineResult(poses, seconds), truth))}
    assert found["latency_median"].value == pytest.approx(2.0)
    assert found["latency_max"].value == pytest.approx(500.0)
    assert 2.0 < found["latency_p99"].value < 10.0
    assert found["latency_max"].unit == "ms"
    assert found["ate_online"].value == pytest.approx(0.1, rel=1e-3)
    blank = online_metrics(OnlineResult(poses, seconds), None)
    assert blank["ate_online"] == "the recording has no truth"
    assert blank["latency_max"] == pytest.approx(500.0)


def test_a_method_that_answers_in_the_end_has_none():
    assert set(online_metrics(None, None).values()) == {"the method answers when the drive is over"}


def test_no_answer_is_no_number():
    n = 5
    recording = Recording("r", np.arange(n), np.ones((n, 3)), np.arange(3), Laser(), np.zeros((n, 3)), "none")
    metrics = evaluate(recording, [NoEstimate("ins", "nobody knows"), Estimate("icp", np.zeros((n, 3)))])
    none = [m for m in metrics if m.method == "ins"]
    assert [m.name for m in none] == [name for name in DEFINITIONS if name not in COST]
    assert all(m.value is None and m.reason == "nobody knows" for m in none)
