"""Recordings that do not tell how the robot moved: who answers, who cannot, and who refuses."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from scenarios.methods import METHODS
from scenarios.methods.config import MethodConfig
from scenarios.run import costs, with_answer
from sim.laser import Raycaster
from slam import se2
from slam.cli import InputError
from slam.recording import Laser, Odometry, Recording
from slam.se2 import Array
from stitch.mapping import Estimate, NoEstimate, map_recording
from stitch.mapping.estimate import rejection_reason

ANGLES = np.radians(np.linspace(-110.0, 110.0, 111))
LASER = Laser(range_max=8.0)
N = 40


def drive() -> Recording:
    """Round a furnished room; its dead reckoning is the truth."""
    angle = np.linspace(0.0, 2.0 * np.pi, N)
    x, y = 3.0 + 1.7 * np.sin(angle), 2.5 - 1.4 * np.cos(angle)
    truth = np.column_stack([x, y, np.arctan2(1.4 * np.sin(angle), 1.7 * np.cos(angle))])
    room = [(0, 0, 6, 5), (2.6, 2, 3.4, 3), (4.8, 0, 6, 0.7)]
    walls = [
        side
        for x0, y0, x1, y1 in room
        for side in ([x0, y0, x1, y0], [x1, y0, x1, y1], [x1, y1, x0, y1], [x0, y1, x0, y0])
    ]
    ranges = Raycaster.from_segments(np.array(walls, dtype=float)).cast(truth, ANGLES, LASER.range_max)
    ranges = ranges + np.random.default_rng(0).normal(0.0, 0.01, ranges.shape)
    return Recording("round", 0.2 * np.arange(N), ranges, ANGLES, LASER, truth, truth=truth)


def rms(poses: Array, truth: Array) -> float:
    apart = se2.between(poses[0], poses)[:, :2] - se2.between(truth[0], truth)[:, :2]
    return float(np.sqrt(np.mean(np.sum(apart**2, axis=1))))


def test_the_laser_alone_maps_a_room():
    found = METHODS["slamstitch"](drive().without_dead_reckoning(), MethodConfig())
    assert isinstance(found, Estimate)
    assert rms(found.poses, drive().truth) < 0.03


def test_no_method_reads_what_dead_reckoning_said():
    """The full-rate odometry is kept for scoring; whatever it says, the answer is the same."""
    odometry = Odometry(np.arange(N), drive().dead_reckoning, np.arange(N))
    told = replace(drive(), odometry=odometry).without_dead_reckoning()
    untold = replace(told, odometry=None)
    for name in ("icp", "slamstitch"):
        first, second = (METHODS[name](recording, MethodConfig()) for recording in (told, untold))
        np.testing.assert_array_equal(first.poses, second.poses)


@pytest.mark.parametrize("name", [name for name, method in METHODS.items() if method.needs_dead_reckoning])
def test_methods_that_need_it_have_no_answer(name):
    recording = drive().without_dead_reckoning()
    found = METHODS[name](recording, MethodConfig())
    assert isinstance(found, NoEstimate)
    assert "the recording has none" in found.reason or "no dead reckoning" in found.reason
    assert isinstance(METHODS[name](drive(), MethodConfig()), Estimate)


def test_a_drive_that_cannot_be_followed_is_refused():
    """Every scan but the first few is blind: nobody knows where the robot went."""
    recording = drive().without_dead_reckoning()
    ranges = recording.ranges.copy()
    ranges[10:] = np.nan
    blind = replace(recording, ranges=ranges)
    found = METHODS["slamstitch"](blind, MethodConfig())
    assert isinstance(found, NoEstimate)
    assert map_recording(blind) == found
    assert "23% of the scans could be matched" in found.reason
    with pytest.raises(InputError, match="slamstitch: 23% of the scans"):
        with_answer([found])


@pytest.mark.parametrize(("along", "said"), [(0.4, None), (0.7, "no better than 0.7 m by the laser alone")])
def test_a_map_that_knows_of_itself_that_it_is_lost_is_refused(along: float, said: str | None):
    """The worst direction counts, whichever it is, and the median: one doubtful scan is no reason."""
    covariance = np.tile(np.diag([1e-4, along**2, 1e-4]), (N, 1, 1))
    covariance[: N // 4] = np.diag([9.0, 9.0, 1.0])
    reason = rejection_reason(Estimate("slamstitch", np.zeros((N, 3)), covariance=covariance))
    assert reason is None if said is None else said in str(reason)


def test_who_has_no_answer_cost_nothing_to_compare():
    metrics = costs([NoEstimate("ins", "why")], drive(), stages=None)  # type: ignore[arg-type]
    assert [m.name for m in metrics] == ["wall_s", "scans_per_s", "peak_mb"]
    assert all(m.value is None for m in metrics)
