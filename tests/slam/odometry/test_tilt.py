"""Scans of a tilted laser: which they are, and that they do not enter the map."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from slam import se2
from slam.odometry.tilt import TiltDetector, tilted_scans
from slam.odometry.tracker import FrontendConfig, track
from slam.recording import Recording
from slam.se2 import Array

Record = Callable[..., Recording]
Drive = Callable[..., Array]


def test_tilted_scans_stand_out_from_their_neighbours(room: Array, record: Record, straight: Drive) -> None:
    attitude = np.zeros((60, 2))
    attitude[30:] += [3.1, -0.4]  # the robot flips and stays on its back
    attitude[10, 0] = 0.2
    attitude[45, 1] += 0.12
    attitude[50, 1] += 0.05
    attitude[31::2, 0] += 0.07  # about half a turn, where the sign of what is logged flips
    recording = record(room, straight(60, 0.05), attitude=se2.wrap(attitude))
    found = np.flatnonzero(tilted_scans(recording, np.radians(5.0), window=11))
    np.testing.assert_array_equal(found, [10, 45])
    assert not np.any(tilted_scans(recording, np.inf))
    assert not np.any(tilted_scans(replace(recording, attitude=None), np.radians(5.0)))


def test_what_a_tilted_laser_saw_is_not_in_the_map(room: Array, record: Record, straight: Drive) -> None:
    attitude = np.zeros((25, 2))
    attitude[7:10] = 0.2
    recording = record(room, straight(), attitude=attitude)
    floor, nothing = recording.ranges.copy(), recording.ranges.copy()
    floor[7:10] -= 0.1
    nothing[7:10] = np.nan
    found = track(replace(recording, ranges=floor), FrontendConfig(extend_distance=0.1))
    expected = track(replace(recording, ranges=nothing), FrontendConfig(extend_distance=0.1))
    np.testing.assert_array_equal(found.poses, expected.poses)
    np.testing.assert_array_equal(found.matches[10:], expected.matches[10:])


def test_a_causal_median_of_the_tilt(room: Array, record: Record, straight: Drive) -> None:
    """A fall tilts until half of the window is fallen; what comes later changes nothing."""
    attitude = np.zeros((25, 2))
    attitude[10:, 0] = 0.2
    recording = record(room, straight(), attitude=attitude)
    detector = TiltDetector(np.radians(5.0), 7)
    tilted = []
    for tilt in attitude.copy():
        tilted.append(detector.is_tilted(tilt))
        tilt[:] = np.nan  # what was given may be overwritten
    np.testing.assert_array_equal(np.flatnonzero(tilted), [10, 11, 12])
    np.testing.assert_array_equal(np.flatnonzero(tilted_scans(recording, np.radians(5.0), 7)), [])
