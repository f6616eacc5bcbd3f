"""The front end without dead reckoning: the laser alone tells how the robot moved."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from slam import se2
from slam.odometry.track import Track, Verdict
from slam.odometry.tracker import track
from slam.recording import Recording
from slam.se2 import Array

Record = Callable[..., Recording]
Drive = Callable[..., Array]
Rms = Callable[[Array, Array], float]
Check = Callable[[Track], None]


def test_the_laser_alone_follows_a_curve(
    room: Array, record: Record, rms: Rms, curve: Drive, assert_consistent: Check
) -> None:
    recording = record(room, curve()).without_dead_reckoning()
    found = track(recording)
    assert_consistent(found)
    assert found.matched_share == 1.0
    np.testing.assert_array_equal(found.poses[0], np.zeros(3))
    assert rms(found.poses, curve()) < 0.02


def test_large_steps_are_searched_for(room: Array, record: Record, rms: Rms) -> None:
    """Half a metre and 15° from scan to scan, three seconds apart."""
    truth = np.column_stack(
        [1.5 + 0.5 * np.arange(8), 2.9 + 0.1 * np.arange(8), np.radians(15.0) * np.tile([0, 1], 4)]
    )
    recording = record(room, truth).without_dead_reckoning()
    found = track(replace(recording, time=3.0 * np.arange(8)))
    assert rms(found.poses, truth) < 0.05


def test_lost_for_long_it_begins_a_new_map_and_is_less_and_less_sure(
    room: Array, record: Record, straight: Drive
) -> None:
    truth = np.concatenate([straight(10), straight(12) + np.array([2.5, -0.9, 0.0])])
    recording = record(room, np.concatenate([truth[:10], np.tile(truth[10], (12, 1)), truth[10:]]))
    ranges = recording.ranges.copy()
    ranges[10:22] = np.nan
    found = track(replace(recording.without_dead_reckoning(), ranges=ranges))
    assert np.all(found.verdict[10:22] == Verdict.FELL_BACK)
    assert np.all(found.verdict[24:] == Verdict.MATCHED)
    steps = se2.between(found.poses[24], found.poses[25:])
    np.testing.assert_allclose(steps, se2.between(truth[12], truth[13:]), atol=0.03)
