"""The driver on its route, and whole simulations of a small world."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest

from sim.corruption import Effects
from sim.driver import DriverConfig, resample
from sim.floorplan import box, wall
from sim.inertial import InertialConfig
from sim.laser import Scanner
from sim.record import Setup, drive, simulate
from sim.terrain import Terrain
from sim.world import World

ROUTE = np.array([[1.0, 1.0], [4.0, 1.0], [4.0, 3.0], [1.0, 3.0], [1.0, 1.3]])
BUSY = DriverConfig(pause_every=1e9)


def room(*furniture) -> World:
    corners = [[0, 0], [5, 0], [5, 4], [0, 4]]
    walls = [p for a, b in zip(corners, corners[1:] + corners[:1], strict=True) for p in wall(a, b)]
    terrain = Terrain.level([-0.5, -0.5], [5.5, 4.5], 0.05).with_sill([2.5, 0.5], [2.5, 1.5], 0.06, 0.25)
    return World((*walls, *furniture), terrain, 2.5)


@dataclass(frozen=True)
class Small:
    """A square drive in one room."""

    setup: Setup
    name: str = "small"

    def build(self, rng: np.random.Generator) -> Setup:
        return self.setup


SETUP = Setup(room(), (1.0, 1.0, 0.0), ROUTE, driver=BUSY)


@pytest.fixture(scope="module")
def run():
    return simulate(Small(SETUP), 3)


def arrays(recording):
    return {k: v for k, v in vars(recording).items() if isinstance(v, np.ndarray)}


def test_same_seed_same_bytes_other_seed_other_bytes(run):
    again, other = simulate(Small(SETUP), 3).recording, simulate(Small(SETUP), 4).recording
    first = arrays(run.recording)
    assert {"time", "ranges", "dead_reckoning", "attitude", "truth"} <= set(first)
    for name, value in first.items():
        assert value.tobytes() == arrays(again)[name].tobytes(), name
    assert not np.array_equal(run.recording.dead_reckoning, other.dead_reckoning)
    assert not np.array_equal(run.recording.ranges, other.ranges, equal_nan=True)


def test_another_name_is_another_draw(run):
    other = simulate(Small(SETUP, "else"), 3)
    assert not np.array_equal(run.recording.dead_reckoning[-1], other.recording.dead_reckoning[-1])


def test_the_route_is_driven_to_its_end(run):
    truth = run.recording.truth
    assert run.ending == "completed"
    assert np.hypot(*(truth[-1, :2] - ROUTE[-1])) < 0.4
    path = resample(ROUTE)
    off = np.hypot(*(truth[:, None, :2] - path[None]).transpose(2, 0, 1)).min(axis=1)
    assert off.max() < 0.35
    assert run.recording.distance == pytest.approx(9.7, rel=0.1)


def test_a_recording_is_what_the_laser_and_the_ins_say(run):
    recording = run.recording
    assert recording.name == "small"
    assert recording.source == "ins"
    assert np.all(np.diff(recording.time) > 0.2)
    assert np.median(np.diff(recording.time)) == pytest.approx(0.3, abs=0.011)
    assert recording.ranges.shape == (len(recording), 228)
    assert np.nanmax(recording.ranges) < 4.0
    np.testing.assert_array_equal(recording.dead_reckoning[0], recording.truth[0])
    assert 0.0 < np.abs(recording.attitude - run.tilt).mean() < np.deg2rad(2.0)


def test_the_sill_tilts_the_robot(run):
    assert np.rad2deg(np.abs(run.tilt[:, 1]).max()) > 4.0
    assert np.rad2deg(np.abs(run.tilt).min()) < 0.1


def test_scans_at_true_poses_lie_on_the_walls(run):
    """While the robot is level, what it sees is the true outline to within noise and mixed pixels."""
    level = np.abs(run.tilt).max(axis=1) < np.deg2rad(0.3)
    recording = run.recording
    yaw = recording.truth[level, 2:3]
    sensor = recording.truth[level, :2] - 0.08 * np.hstack([np.cos(yaw), np.sin(yaw)])
    bearing = yaw + recording.angles
    points = sensor[:, None] + recording.ranges[level, :, None] * np.stack(
        [np.cos(bearing), np.sin(bearing)], -1
    )
    points = points[np.isfinite(points[..., 0])]
    a, e = run.walls[:, :2], run.walls[:, 2:] - run.walls[:, :2]
    t = np.clip(np.einsum("pek,ek->pe", points[:, None] - a, e) / np.sum(e * e, axis=1), 0.0, 1.0)
    distance = np.linalg.norm(points[:, None] - a - t[..., None] * e, axis=2).min(axis=1)
    assert np.median(distance) < 0.012
    assert np.quantile(distance, 0.98) < 0.05


@pytest.mark.parametrize(
    "change",
    [
        {"scanner": Scanner(effects=Effects(noise=False))},
        {"inertial": InertialConfig(model="consistent")},
        {"driver": replace(BUSY, speed=0.5)},
    ],
)
def test_a_change_of_one_stage_leaves_the_others_draws(run, change):
    changed = simulate(Small(replace(SETUP, **change)), 3).recording
    same_drive = "driver" not in change
    assert np.array_equal(changed.truth[:20], run.recording.truth[:20]) == same_drive
    same_ins = same_drive and "inertial" not in change
    assert np.array_equal(changed.dead_reckoning[:20], run.recording.dead_reckoning[:20]) == same_ins
    same_scans = same_drive and "scanner" not in change
    assert np.array_equal(changed.ranges[:20], run.recording.ranges[:20], equal_nan=True) == same_scans


def test_a_blocked_robot_backs_off_and_gives_up_honestly():
    walled_in = room(
        box([2.5, 1.0, 0.0], 0.2, 1.9), box([2.5, 3.0, 0.0], 0.2, 1.9), box([2.5, 2.0, 0.0], 0.2, 0.4)
    )
    setup = replace(SETUP, world=walled_in, driver=replace(BUSY, attempts=2))
    driven = drive(setup, np.random.default_rng(0))
    assert driven.ending == "stuck"
    assert driven.states[:, 0].max() < 2.4
    assert np.diff(driven.states[:, 0]).min() < -0.005


def test_an_obstacle_in_the_way_is_left_behind():
    """A pole half across the route: backing off and turning gets round it."""
    setup = replace(SETUP, world=room(box([2.5, 0.92, 0.0], 0.1, 0.1)), driver=replace(BUSY, attempts=30))
    assert drive(setup, np.random.default_rng(1)).ending == "completed"


def test_time_runs_out():
    setup = replace(SETUP, driver=replace(BUSY, time_limit=2.0))
    driven = drive(setup, np.random.default_rng(0))
    assert driven.ending == "out of time"
    assert driven.time[-1] == pytest.approx(2.0, abs=0.1)


def test_a_flipped_robot_ends_the_drive():
    x, _ = SETUP.world.terrain.nodes()
    cliff = Terrain(np.where(x > 2.0, -3.0 * (x - 2.0), 0.0), np.zeros_like(x), (-0.5, -0.5), 0.05)
    driven = drive(replace(SETUP, world=replace(SETUP.world, terrain=cliff)), np.random.default_rng(0))
    assert driven.ending == "flipped over"
    assert np.abs(driven.states[-1, 4]) > np.deg2rad(55.0)


def test_the_driver_pauses():
    pausing = drive(
        replace(SETUP, driver=DriverConfig(pause_every=3.0, pause_mean=3.0)), np.random.default_rng(0)
    )
    busy = drive(SETUP, np.random.default_rng(0))
    still = np.hypot(*np.diff(pausing.states[:, :2], axis=0).T) < 1e-4
    assert still.mean() > 0.15
    assert pausing.time[-1] > busy.time[-1] + 2.0


def test_a_route_needs_two_waypoints():
    with pytest.raises(ValueError, match="waypoints"):
        resample([[0.0, 0.0]])
    np.testing.assert_allclose(
        resample([[0, 0], [1, 0], [1, 1]], 0.5), [[0, 0], [0.5, 0], [1, 0], [1, 0.5], [1, 1]]
    )
