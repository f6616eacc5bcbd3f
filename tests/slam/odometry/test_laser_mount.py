"""The laser's mount by hand-eye calibration: drives made with a known one, and Intel's."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from slam import se2
from slam.formats import load
from slam.odometry import laser_mount, tracker
from slam.odometry.track import Track, Verdict
from slam.recording import Laser, Recording
from slam.se2 import Array

SCANS = 400
T_ROBOT_LASER = np.array([0.09, -0.03, np.radians(-2.0)])


def chained(steps: Array) -> Array:
    poses = [np.zeros(3)]
    for step in steps:
        poses.append(se2.compose(poses[-1], step))
    return np.array(poses)


def driven(
    T_robot_laser: Array, turning: float = 0.2, scale: float = 1.0, lost: float = 0.0, seed: int = 0
) -> tuple[Recording, Track]:
    """A drive with noisy odometry that counts ``scale`` too much, and where a matcher saw the laser.

    ``lost``: share of the steps in which the matcher was a metre off.
    """
    rng = np.random.default_rng(seed)
    steps = np.column_stack(
        [rng.uniform(0.1, 0.4, SCANS - 1), np.zeros(SCANS - 1), turning * rng.standard_normal(SCANS - 1)]
    )
    robot = chained(steps)
    odometry = chained((scale, scale, 1.0) * steps + (0.01, 0.01, 0.01) * rng.standard_normal(steps.shape))
    laser = se2.compose(robot, T_robot_laser)
    seen = se2.between(laser[:-1], laser[1:]) + (0.005, 0.005, 0.002) * rng.standard_normal(steps.shape)
    seen[rng.random(len(seen)) < lost, :2] += 1.0
    return recorded(odometry), tracked(chained(seen))


def recorded(odometry: Array, truth: Array | None = None, laser: Laser | None = None) -> Recording:
    laser = laser or Laser(range_min=0.1, range_max=20.0)
    n = len(odometry)
    return Recording("made", np.arange(n), np.ones((n, 3)), np.arange(3.0), laser, odometry, truth=truth)


def tracked(poses: Array) -> Track:
    n = len(poses)
    verdict = np.full(n, Verdict.MATCHED)
    verdict[0] = Verdict.SKIPPED
    none = np.full((n, 3, 3), np.nan)
    return Track(poses, verdict, np.arange(n) - 1, none, none, np.zeros(n), {})


@pytest.mark.parametrize("scale", [1.0, 1.05])
@pytest.mark.parametrize("lost", [0.0, 0.1])
def test_a_known_mount_is_found_within_what_it_says(scale: float, lost: float) -> None:
    errors = []
    for seed in range(10):
        found = laser_mount.estimate_mount(*driven(T_ROBOT_LASER, scale=scale, lost=lost, seed=seed))
        assert found is not None
        errors.append((found.T_robot_laser - T_ROBOT_LASER) / found.sigma)
        assert np.abs(found.T_robot_laser - T_ROBOT_LASER)[:2].max() < 0.02
    assert 0.4 < np.mean(np.square(errors)) < 2.5


def test_a_laser_at_the_origin_is_left_there() -> None:
    found = [laser_mount.estimate_mount(*driven(np.zeros(3), seed=seed)) for seed in range(10)]
    assert found == [None] * 10


def test_a_drive_that_does_not_turn_does_not_tell() -> None:
    assert laser_mount.estimate_mount(*driven(T_ROBOT_LASER, turning=0.0005)) is None


def test_a_few_steps_do_not_tell() -> None:
    recording, track = driven(T_ROBOT_LASER)
    track.verdict[laser_mount.LaserMountConfig().min_steps :] = Verdict.FELL_BACK
    assert laser_mount.estimate_mount(recording, track) is None


def test_what_is_stated_is_not_asked() -> None:
    poses = np.zeros((5, 3))
    assert laser_mount.is_mount_unstated(recorded(poses))
    assert not laser_mount.is_mount_unstated(recorded(poses, truth=poses))
    assert not laser_mount.is_mount_unstated(recorded(poses).without_dead_reckoning())
    assert not laser_mount.is_mount_unstated(recorded(poses).with_laser_mount(T_ROBOT_LASER))
    assert not laser_mount.is_mount_unstated(recorded(poses).with_laser_mount(np.zeros(3)))


def test_it_says_what_it_found() -> None:
    found = laser_mount.Mount(
        np.array([0.09, -0.03, np.radians(-2.0)]), np.array([0.001, 0.002, np.radians(0.05)])
    )
    assert str(found) == "x 0.090 ± 0.001 m, y -0.030 ± 0.002 m, yaw -2.00 ± 0.05°"


def test_intels_laser_is_ahead_of_its_wheels(shared_data: Path) -> None:
    recording = load(shared_data / "carmen/intel.raw.log.gz")
    found = laser_mount.estimate_mount(recording, tracker.track(recording))
    assert found is not None
    np.testing.assert_allclose(found.T_robot_laser, [0.09, 0.0, np.radians(-1.1)], atol=0.01)
