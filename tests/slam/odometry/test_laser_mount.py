"""The laser's mount by hand-eye calibration: made drives, drives in a simulated room, and Intel's."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import chi2

from slam import se2
from slam.formats import load
from slam.odometry import laser_mount
from slam.odometry.laser_mount import Mount, NoMount
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
    surely = np.tile(1e6 * np.eye(3), (n, 1, 1))
    return Track(poses, verdict, np.arange(n) - 1, none, surely, np.zeros(n), {})


@pytest.mark.parametrize("scale", [1.0, 1.05])
@pytest.mark.parametrize("lost", [0.0, 0.1])
@pytest.mark.parametrize("yaw", [-2.0, 90.0, 180.0, -135.0])
def test_a_known_mount_is_found_within_what_it_says(scale: float, lost: float, yaw: float) -> None:
    mount, errors = np.array([0.09, -0.03, np.radians(yaw)]), []
    for seed in range(10):
        found = laser_mount.estimate_mount(*driven(mount, scale=scale, lost=lost, seed=seed))
        assert isinstance(found, Mount)
        errors.append(distance(found, mount))
        assert np.abs(found.T_robot_laser - mount)[:2].max() < 0.02
    assert_chi_squared(errors)


def distance(found: Mount, mount: Array) -> float:
    """Squared Mahalanobis distance of an estimate from the mount."""
    error = found.T_robot_laser - mount
    error[2] = se2.wrap(error[2])
    return float(error @ np.linalg.solve(found.covariance, error))


def assert_chi_squared(distances: list[float]) -> None:
    """Their sum lies within the χ² band that one of a thousand honest estimators leaves."""
    low, high = chi2.ppf([0.0005, 0.9995], 3 * len(distances))
    assert low < np.sum(distances) < high


def test_a_laser_at_the_origin_is_left_there() -> None:
    for seed in range(10):
        reason = why(laser_mount.estimate_mount(*driven(np.zeros(3), seed=seed)))
        assert reason == "the drive agrees with a laser at the robot's origin"


def why(found: Mount | NoMount) -> str:
    assert isinstance(found, NoMount)
    return found.reason


def test_a_drive_that_does_not_turn_tells_the_yaw_alone() -> None:
    straight = np.array([0.2, 0.1, np.radians(170.0)])
    found = laser_mount.estimate_mount(*driven(straight, turning=0.0))
    assert isinstance(found, Mount)
    assert found.T_robot_laser[:2].tolist() == [0.0, 0.0]
    assert abs(found.T_robot_laser[2] - straight[2]) < 3.3 * found.sigma[2] < np.radians(1.0)
    assert "turns too little to tell" in str(found)
    ahead = laser_mount.estimate_mount(*driven(np.array([0.2, 0.1, 0.0]), turning=0.0))
    assert why(ahead) == "the drive turns too little to tell, and agrees with a yaw of 0"


def test_without_any_noise_it_is_found_all_the_same() -> None:
    steps = np.tile([0.2, 0.0, 0.1], (SCANS - 1, 1))
    robot = chained(steps * np.sign(np.sin(np.arange(SCANS - 1)))[:, None] ** [0, 0, 1])
    laser = se2.between(T_ROBOT_LASER, se2.compose(robot, T_ROBOT_LASER))
    found = laser_mount.estimate_mount(recorded(robot), tracked(laser))
    assert isinstance(found, Mount)
    np.testing.assert_allclose(found.T_robot_laser, T_ROBOT_LASER, atol=1e-6)


def test_a_few_steps_do_not_tell() -> None:
    recording, track = driven(T_ROBOT_LASER)
    track.verdict[laser_mount.LaserMountConfig().min_steps :] = Verdict.FELL_BACK
    assert why(laser_mount.estimate_mount(recording, track)).endswith("in 49 steps, expected 50")


def test_small_steps_are_put_together() -> None:
    """A laser of forty scans a second moves by millimetres from one to the next."""
    recording, track = driven(T_ROBOT_LASER)
    slow = np.linspace(0.0, 1.0, 20)[:, None] * recording.dead_reckoning[1]
    found = laser_mount.estimate_mount(
        recorded(np.concatenate([slow, recording.dead_reckoning[2:]])),
        tracked(np.concatenate([np.linspace(0.0, 1.0, 20)[:, None] * track.poses[1], track.poses[2:]])),
    )
    assert isinstance(found, Mount)
    np.testing.assert_allclose(found.T_robot_laser, T_ROBOT_LASER, atol=0.01)


def test_what_the_match_did_not_see_does_not_count() -> None:
    """Along a bare corridor a matcher repeats what dead reckoning said: any laser looks centred."""
    recording, track = driven(T_ROBOT_LASER)
    track.information[:, 0, 0] = 1e-3
    assert "in 0 steps, expected 50" in why(laser_mount.estimate_mount(recording, track))


def test_a_laser_that_turns_the_other_way_hangs_upside_down() -> None:
    recording, track = driven(T_ROBOT_LASER)
    mirrored = tracked(track.poses * [1.0, -1.0, -1.0])
    assert "upside down" in why(laser_mount.estimate_mount(recording, mirrored))


def test_an_odometry_of_another_drive_tells_nothing() -> None:
    recording, track = driven(T_ROBOT_LASER, scale=3.0)
    assert "times the way that the odometry counts" in why(laser_mount.estimate_mount(recording, track))


# In a simulated room, by the real front end


def eight(n: int) -> Array:
    """True poses ``(n, 3)`` of a figure of eight in the room."""
    t = np.linspace(0.0, 2.0 * np.pi, n)
    heading = np.arctan2(np.cos(2.0 * t), 1.2 * np.cos(t))
    return np.column_stack([4.0 + 1.2 * np.sin(t), 3.1 + 0.5 * np.sin(2.0 * t), heading])


def in_the_room(room: Array, record: Callable[..., Recording], mount: Array, seed: int) -> Recording:
    """A drive with wheels that count 3 % too much, in which nobody states the mount."""
    rng, truth = np.random.default_rng(seed), eight(150)
    steps = se2.between(truth[:-1], truth[1:]) * [1.03, 1.0, 1.0]
    wheels = se2.compose(truth[0], chained(steps + 0.004 * rng.standard_normal(steps.shape)))
    seen = record(room, se2.compose(truth, mount), wheels, seed=seed)
    return replace(seen, truth=None)


def test_any_yaw_is_found_within_what_it_says(room: Array, record: Callable[..., Recording]) -> None:
    distances = []
    for seed, yaw in enumerate([0.0, 10.0, 90.0, 180.0, -135.0]):
        mount = np.array([0.2, -0.1, np.radians(yaw)])
        found = laser_mount.find_mount(in_the_room(room, record, mount, seed))
        assert isinstance(found, Mount), (yaw, found)
        assert np.hypot(*(found.T_robot_laser - mount)[:2]) < 0.02
        assert abs(se2.wrap(found.T_robot_laser[2] - mount[2])) < np.radians(1.5)
        distances.append(distance(found, mount))
    assert_chi_squared(distances)


def test_a_laser_at_the_middle_of_a_simulated_robot_is_left_there(
    room: Array, record: Callable[..., Recording]
) -> None:
    found = laser_mount.find_mount(in_the_room(room, record, np.zeros(3), seed=1))
    assert why(found) == "the drive agrees with a laser at the robot's origin"


def test_what_is_stated_is_not_asked() -> None:
    poses = np.zeros((5, 3))
    assert laser_mount.is_mount_unstated(recorded(poses))
    assert not laser_mount.is_mount_unstated(recorded(poses, truth=poses))
    assert not laser_mount.is_mount_unstated(recorded(poses).without_dead_reckoning())
    assert not laser_mount.is_mount_unstated(recorded(poses).with_laser_mount(T_ROBOT_LASER))
    assert not laser_mount.is_mount_unstated(recorded(poses).with_laser_mount(np.zeros(3)))


def test_it_says_what_it_found() -> None:
    sigma = np.array([0.001, 0.002, np.radians(0.05)])
    found = Mount(np.array([0.09, -0.03, np.radians(-2.0)]), np.diag(sigma**2))
    assert str(found) == "x 0.090 ± 0.001 m, y -0.030 ± 0.002 m, yaw -2.00 ± 0.05°"


def test_intels_laser_is_ahead_of_its_wheels(shared_data: Path) -> None:
    found = laser_mount.find_mount(load(shared_data / "carmen/intel.raw.log.gz"))
    assert isinstance(found, Mount)
    np.testing.assert_allclose(found.T_robot_laser, [0.09, 0.0, np.radians(-1.1)], atol=0.01)
