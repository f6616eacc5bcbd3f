"""An odometry that lags or has lost its sign is found out by the matches, and mended."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from slam import se2
from slam.odometry.odometry_faults import OdometryFaultConfig, find_faults
from slam.odometry.track import Track, Verdict
from slam.recording import Laser, Recording
from slam.se2 import Array

SCANS = 200


def chained(steps: Array) -> Array:
    poses = [np.zeros(3)]
    for step in steps:
        poses.append(se2.compose(poses[-1], step))
    return np.array(poses)


def driven(backwards: float = 0.1) -> Array:
    """Steps of a robot that turns about, and at times drives backwards."""
    rng = np.random.default_rng(0)
    ahead = rng.uniform(0.1, 0.4, SCANS - 1) * np.where(rng.random(SCANS - 1) < backwards, -1.0, 1.0)
    return np.column_stack([ahead, np.zeros(SCANS - 1), 0.2 * rng.standard_normal(SCANS - 1)])


def recorded(told: Array) -> Recording:
    ranges = np.ones((SCANS, 3))
    return Recording("made", np.arange(SCANS), ranges, np.arange(3.0), Laser(), chained(told))


def seen(steps: Array, lost: float = 0.1) -> Track:
    """What a matcher sees, which is lost at times."""
    rng = np.random.default_rng(1)
    noisy = steps + rng.normal(0.0, 0.003, steps.shape)
    verdict = np.where(rng.random(SCANS) < lost, Verdict.FELL_BACK, Verdict.MATCHED)
    none = np.full((SCANS, 3, 3), np.nan)
    return Track(chained(noisy), verdict, np.arange(SCANS) - 1, none, none, np.zeros(SCANS), {})


def late(steps: Array, delay: int) -> Array:
    return np.roll(steps, delay, axis=0)


@pytest.mark.parametrize("delay", [-2, 1, 4])
def test_a_delay_is_found_and_taken_back(delay: int) -> None:
    steps = driven()
    recording = recorded(late(steps, delay))
    faults = find_faults(recording, seen(steps))
    assert faults
    assert faults.delay == delay
    mended = faults.corrected(recording).dead_reckoning
    told = se2.between(mended[:-1], mended[1:])
    known = slice(0, SCANS - 1 - delay) if delay > 0 else slice(-delay, None)
    np.testing.assert_allclose(told[known], steps[known], atol=1e-12)
    assert str(faults) == {-2: "2 scans early", 1: "1 scan late", 4: "4 scans late"}[delay]


def test_a_lost_sign_is_found_and_given_back() -> None:
    steps = driven()
    recording = recorded(np.abs(steps) * [1, 1, 0] + steps * [0, 0, 1])
    track = seen(steps)
    faults = find_faults(recording, track)
    matched = track.verdict == Verdict.MATCHED
    np.testing.assert_array_equal(faults.backwards, (steps[:, 0] < 0.0) & matched[1:] & matched[:-1])
    mended = faults.corrected(recording).dead_reckoning
    told = se2.between(mended[:-1], mended[1:])
    np.testing.assert_allclose(told[faults.backwards, 0], steps[faults.backwards, 0], atol=1e-12)
    assert str(faults) == f"without sign ({faults.backwards.sum()} steps backwards)"


def test_an_honest_odometry_is_left_alone() -> None:
    steps = driven()
    faults = find_faults(recorded(1.1 * steps), seen(steps))
    assert not faults
    assert str(faults) == "as recorded"
    unmatched = find_faults(recorded(late(steps, 1)), seen(steps, lost=1.0))
    assert not unmatched


def test_a_laser_that_looks_backwards_is_no_lost_sign() -> None:
    steps = driven(backwards=0.0)
    assert not find_faults(recorded(steps), seen(steps * [-1.0, 1.0, 1.0]))


LATE, UNSIGNED = "late", "unsigned"
CHANGED = {
    "max_delay": (0, LATE),
    "delay_gain": (0.0, LATE),
    "metre": (1e3, LATE),
    "cap": (1e-9, LATE),
    "min_backwards": (0, UNSIGNED),
    "max_backwards": (0.01, UNSIGNED),
    "sign_tolerance": (1e-9, UNSIGNED),
    "least_step": (10.0, UNSIGNED),
}
"""Every setting, a value with which nothing is found, and of what."""


@pytest.mark.parametrize("name", CHANGED)
def test_every_setting_changes_what_is_found(name: str) -> None:
    value, fault = CHANGED[name]
    steps = driven(backwards=0.0 if fault == LATE else 0.1)
    told = late(steps, 2) if fault == LATE else np.abs(steps) * [1, 1, 0] + steps * [0, 0, 1]
    straight = np.column_stack([np.full(SCANS - 1, 0.2), np.zeros((SCANS - 1, 2))])
    if name == "metre":  # what differs is the turning alone, which metres then drown
        steps, told = steps * [0, 0, 1] + straight, told * [0, 0, 1] + straight
    recording, track = recorded(told), seen(steps)
    assert find_faults(recording, track)
    assert not find_faults(recording, track, replace(OdometryFaultConfig(), **{name: value}))
