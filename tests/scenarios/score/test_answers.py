"""Answers are matched to scans by their stamps, and what is missing is never made up unsaid."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from scenarios.score.answers import interpolated, match, read_answers, to_estimate
from slam import se2
from slam.cli import InputError
from slam.formats import tum
from slam.recording import Recording
from slam.se2 import Array
from slam.trajectory import Trajectory
from stitch.mapping.estimate import Estimate, NoEstimate


def truth_of(recording: Recording) -> Array:
    assert recording.truth is not None
    return recording.truth


def answered(found: Trajectory, recording: Recording, body: str = "robot") -> tuple[Estimate, float]:
    estimate, coverage = to_estimate("a", found, recording, 0.02, body)  # type: ignore[arg-type]
    assert isinstance(estimate, Estimate)
    return estimate, coverage


def test_the_nearest_stamp_within_the_tolerance() -> None:
    scans = np.array([1.0, 2.0, 3.0, 4.0])
    time = np.array([4.02, 1.005, 0.99, 2.5, 2.019])
    np.testing.assert_array_equal(match(time, scans, 0.021), [1, 4, -1, 0])
    np.testing.assert_array_equal(match(time, scans, 0.015), [1, -1, -1, -1])


def test_stamps_that_repeat_and_go_backwards_are_taken_in_order() -> None:
    scans = np.array([5.0, 4.0, 4.0, 6.0])
    np.testing.assert_array_equal(match(scans + 0.001, scans, 0.02), [0, 1, 2, 3])
    np.testing.assert_array_equal(match(scans[::-1], scans, 0.02), [3, 1, 1, 0])


def test_between_poses_it_is_interpolated_the_shorter_way_round() -> None:
    poses = np.array([[9.0, 9, 9], [0, 0, 3.0], [9, 9, 9], [2, 4, -3.0], [9, 9, 9]])
    filled = interpolated(poses, np.array([False, True, False, True, False]))
    np.testing.assert_allclose(filled[[1, 3]], poses[[1, 3]])
    np.testing.assert_allclose(filled[2, :2], [1, 2])
    assert abs(filled[2, 2]) == pytest.approx(np.pi)
    np.testing.assert_allclose(filled[[0, 4]], poses[[1, 3]])


def test_a_tenth_may_be_missing_and_no_more(turning: Recording) -> None:
    sigma = np.tile(np.eye(3), (40, 1, 1))
    kept = np.ones(40, dtype=bool)
    kept[[7, 20, 21, 30]] = False
    found = Trajectory(turning.time[kept], truth_of(turning)[kept], sigma[kept])
    estimate, coverage = answered(found, turning)
    assert coverage == 0.9
    np.testing.assert_allclose(estimate.poses[kept], truth_of(turning)[kept])
    assert estimate.covariance is not None
    assert np.all(np.isnan(estimate.covariance[~kept]))
    fewer = Trajectory(found.time[1:], found.poses[1:])
    refused, coverage = to_estimate("a", fewer, turning, 0.02, "robot")
    assert refused == NoEstimate("a", "poses for 87.5 % of the scans, expected at least 90 %")
    assert coverage == 0.875


def test_poses_of_the_laser_become_the_robot_s(turning: Recording) -> None:
    mount = np.array([0.3, -0.1, 0.4])
    mounted = turning.with_laser_mount(mount)
    seen = Trajectory(turning.time, se2.compose(truth_of(turning), mount), np.tile(np.eye(3), (40, 1, 1)))
    for found, body in ((seen, "laser"), (replace(seen, body="laser"), "robot")):
        estimate, _ = answered(found, mounted, body)
        np.testing.assert_allclose(estimate.poses, truth_of(turning), atol=1e-12)
        assert estimate.covariance is not None
        np.testing.assert_allclose(estimate.covariance[3], se2.transport(np.eye(3), mount))
    estimate, _ = answered(replace(seen, body="robot"), mounted, "laser")
    np.testing.assert_array_equal(estimate.poses, seen.poses)


def test_stamps_of_another_clock_are_told_apart(turning: Recording) -> None:
    found = Trajectory(turning.time + 1e9, truth_of(turning))
    with pytest.raises(InputError, match=r"a: none of its 40 stamps, 1000000000.000 to .* 0.000 to 7.800 s"):
        to_estimate("a", found, turning, 0.02, "robot")


def test_names_are_those_of_the_files_and_no_two_share_a_file(tmp_path: Path) -> None:
    names = ("x/a.tum", "y/a.tum", "a_.tum", "<b>\x1b\n.tum", "ins.tum", "é" * 200 + ".tum"[:0])
    paths = [tmp_path / name for name in names[:-1]] + [tmp_path / ("é" * 100 + ".tum")]
    for path in paths:
        path.parent.mkdir(exist_ok=True)
        tum.write(path, [0.0], np.zeros((1, 3)))
    found = [one.name for one in read_answers(paths, ["ins"])]
    assert found == ["a", "a 2", "a_ 2", "<b>_", "ins 2", "é" * 60]
