"""Things that move with the robot are taken out of its scans; walls are not."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from slam.odometry.ego_motion_filter import remove_co_moving_points
from slam.recording import Recording
from slam.scan import scans_of
from slam.se2 import Array

Record = Callable[..., Recording]
LEADER = slice(75, 106)


@pytest.fixture
def led(room: Array, record: Record) -> Recording:
    """A drive through the room behind a flat back 0.8 m ahead."""
    truth = np.column_stack([1.0 + 0.1 * np.arange(25), np.full(25, 3.2), np.zeros(25)])
    recording = record(room, truth, source="ins")
    ranges = recording.ranges.copy()
    ranges[:, LEADER] = 0.8 / np.cos(recording.angles[LEADER])
    return replace(recording, ranges=ranges)


def test_a_leader_is_taken_out_and_the_walls_stay(led: Recording) -> None:
    scans = scans_of(led)
    kept = remove_co_moving_points(led, scans)
    leader = np.arange(181)[LEADER]
    for before, after in zip(scans[3:], kept[3:], strict=True):
        assert len(np.intersect1d(after.beams, leader)) <= 2
        lost = np.setdiff1d(before.beams, after.beams)
        assert len(np.setdiff1d(lost, leader)) <= 6
    # Before the robot has moved nobody can tell.
    np.testing.assert_array_equal(kept[0].beams, scans[0].beams)


def test_without_a_leader_all_stays(room: Array, record: Record) -> None:
    truth = np.column_stack([1.0 + 0.1 * np.arange(25), np.full(25, 3.2), 0.02 * np.arange(25)])
    recording = record(room, truth, source="ins")
    scans = scans_of(recording)
    kept = remove_co_moving_points(recording, scans)
    assert sum(map(len, kept)) > 0.98 * sum(map(len, scans))


def test_a_robot_at_rest_sees_no_companions(room: Array, record: Record) -> None:
    recording = record(room, np.tile([2.0, 3.0, 0.4], (10, 1)), source="ins")
    scans = scans_of(recording)
    assert [len(s) for s in remove_co_moving_points(recording, scans)] == [len(s) for s in scans]


def test_wheels_may_slip_so_their_scans_stay(led: Recording) -> None:
    wheeled = replace(led, source="odometry")
    scans = scans_of(wheeled)
    assert [len(s) for s in remove_co_moving_points(wheeled, scans)] == [len(s) for s in scans]


def test_blind_scans(led: Recording) -> None:
    ranges = led.ranges.copy()
    ranges[4:8] = np.nan
    blind = replace(led, ranges=ranges)
    kept = remove_co_moving_points(blind, scans_of(blind))
    assert [len(s) for s in kept[4:8]] == [0, 0, 0, 0]
