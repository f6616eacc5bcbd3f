"""The driver on its route, and whole simulations of a small world."""

from __future__ import annotations

import os
import subprocess
import sys
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

from sim.dead_reckoning import InertialConfig, OdometryConfig
from sim.driver import Driver, DriverConfig, resample
from sim.floorplan import box, wall
from sim.laser import Scanner
from sim.laser_effects import Effects
from sim.record import Setup, drive, simulate
from sim.robot import RobotConfig
from sim.smoke import Smoke
from sim.terrain import Terrain
from sim.world import Debris, Person, World
from slam.formats import recording_npz

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


QUIET = Effects(mixed_pixels=False, dropouts=False, noise=False, quantisation=False)
CRATE = Debris(box([3.0, 1.0, 0.0], 0.3, 0.3, z_hi=0.4), 4.0)
FULL = replace(
    SETUP,
    world=replace(
        SETUP.world,
        smoke=Smoke.clear([0, 0], [5, 4]).with_disc([2.5, 2.0], 1.0, 0.7, edge=0.3),
        debris=(CRATE,),
        people=(Person(np.array([[0.5, 3.6], [4.5, 3.6]]), keep_off=0.4),),
    ),
)


def ahead(recording, row):
    """Shortest range of the beams within 2° of straight on."""
    return np.nanmin(recording.ranges[row, np.abs(recording.angles) < np.deg2rad(2.0)])


def test_debris_is_seen_where_it_was_pushed_to():
    """Straight on to a crate: while it lies 3 m along, then always at the bumper: 0.2 + 0.08 m."""
    setup = replace(
        SETUP,
        world=replace(SETUP.world, terrain=Terrain.level([0, 0], [5, 4]), debris=(CRATE,)),
        waypoints=np.array([[1.0, 1.0], [4.0, 1.0]]),
        scanner=Scanner(effects=QUIET),
    )
    run = simulate(Small(setup), 0)
    recording, crate = run.recording, run.movers[:, 0]
    assert crate[0] == pytest.approx((3.0, 1.0, 0.0))
    assert ahead(recording, 0) == pytest.approx(3.0 - 0.15 - 0.92, abs=0.002)
    assert ahead(recording, -1) == pytest.approx(0.28, abs=0.02)
    assert crate[-1, 0] > 3.4
    gap = crate[:, 0] - 0.15 - recording.truth[:, 0] + 0.08
    seen = [ahead(recording, n) for n in range(len(recording))]
    np.testing.assert_allclose(seen, gap, atol=0.03)


def test_a_person_is_seen_at_the_right_range_at_the_right_time():
    """A robot that stays at (1, 1); somebody comes down its axis from 4.5 m at 0.5 m/s, in at 0.2 m."""
    person = Person(np.array([[4.5, 1.0], [2.0, 1.0]]), speed=0.5, radius=0.2)
    setup = replace(
        SETUP,
        world=World(room().prisms, Terrain.level([0, 0], [5, 4]), 2.5, people=(person,)),
        scanner=Scanner(effects=QUIET),
        driver=replace(BUSY, speed=0.0, turn_rate=0.0, time_limit=3.0, stuck_time=99.0),
    )
    run = simulate(Small(setup), 0)
    assert run.ending == "out of time"
    time = run.recording.time
    np.testing.assert_allclose(run.movers[:, 0, 0], 4.5 - 0.5 * time, atol=1e-6)
    expected = 4.5 - 0.5 * time - 0.2 - 0.92
    near = expected < 3.9
    seen = np.array([ahead(run.recording, n) for n in range(len(time))])
    np.testing.assert_allclose(seen[near], expected[near], atol=0.015)  # eight sides, beams 1° apart
    assert near.sum() > 5


def test_smoke_takes_beams():
    smoky, clear = (
        simulate(Small(setup), 3).recording
        for setup in (FULL, replace(FULL, world=replace(FULL.world, smoke=None)))
    )
    np.testing.assert_array_equal(smoky.truth, clear.truth)
    assert np.isfinite(smoky.ranges).mean() < np.isfinite(clear.ranges).mean() - 0.02


def test_odometry_counts_on_at_a_wall_while_the_robot_stands():
    """A closed door across the route: the truth ends there, the encoders go on until he backs off."""
    setup = replace(
        SETUP,
        world=room(box([2.5, 2.0, 0.0], 0.2, 4.0)),
        dead_reckoning="odometry",
        odometry=OdometryConfig(slip=0.0, slip_per_tilt=0.0, burst_rate=0.0, skid_ratio=1.5),
        driver=replace(BUSY, stuck_time=4.0, time_limit=6.0, caution=0.0),
    )
    recording = simulate(Small(setup), 0).recording
    wall_at = 2.4 - 0.5 * RobotConfig().length
    assert recording.truth[:, 0].max() == pytest.approx(wall_at, abs=0.02)
    assert recording.dead_reckoning[:, 0].max() > wall_at + 1.5
    before = slice(None, int(np.argmax(recording.truth[:, 0] > wall_at - 0.1)))
    np.testing.assert_allclose(  # the tracks spin a little as he sets off
        recording.dead_reckoning[before, 0], recording.truth[before, 0], atol=0.05
    )


@pytest.mark.parametrize(
    ("change", "source", "has_attitude"),
    [
        ({}, "ins", True),
        ({"inertial": InertialConfig(model="consistent")}, "odometry", True),
        ({"dead_reckoning": "odometry"}, "odometry", False),
    ],
)
def test_dead_reckoning_is_the_set_ups_choice(run, change, source, has_attitude):
    recording = simulate(Small(replace(SETUP, **change)), 3).recording
    assert recording.source == source
    assert (recording.attitude is not None) == has_attitude
    np.testing.assert_array_equal(recording.ranges, run.recording.ranges)
    assert np.array_equal(recording.dead_reckoning, run.recording.dead_reckoning) == (not change)


def test_tracks_drive_as_far_as_the_robot_and_their_difference_turns_it():
    """Skid ratio 1.5 times 0.22 m between the tracks for every radian."""
    driven = drive(replace(SETUP, world=room(), driver=replace(BUSY, caution=0.0)), np.random.default_rng(0))
    distance = np.hypot(*np.diff(driven.states[:, :2], axis=0).T).sum()
    left, right = driven.tracks[-1]
    assert 0.5 * (left + right) == pytest.approx(distance, rel=0.02)
    turned = driven.states[-1, 2] - driven.states[0, 2]
    assert turned > np.pi
    assert right - left == pytest.approx(1.5 * 0.22 * turned, rel=0.05)


def test_a_blow_is_felt_once():
    """At a closed door: hard when he runs into it, and not while he leans on it."""
    blocked = replace(SETUP, world=room(box([2.5, 2.0, 0.0], 0.2, 4.0)), driver=replace(BUSY, attempts=0))
    driven = drive(blocked, np.random.default_rng(0))
    assert driven.ending == "stuck"
    assert driven.impulse.max() > 5.0
    assert np.sum(driven.impulse > 5.0) <= 2


def test_dead_reckoning_can_be_overridden(run):
    setup = replace(SETUP, dead_reckoning="odometry")
    np.testing.assert_array_equal(
        simulate(Small(setup), 3, dead_reckoning="ins").recording.dead_reckoning,
        run.recording.dead_reckoning,
    )
    assert simulate(Small(SETUP), 3, dead_reckoning="odometry").recording.source == "odometry"
    with pytest.raises(ValueError, match="dead reckoning"):
        simulate(Small(SETUP), 3, dead_reckoning="gps")  # type: ignore[arg-type]


def test_a_consistent_ins_has_body_frame_increments_of_the_truth():
    """Without noise of its own: what it says of each step is the true step, however wrong its yaw is."""
    model = InertialConfig(model="consistent", yaw_noise=0.0, position_noise=0.0, bias_walk=0.05)
    recording = simulate(Small(replace(SETUP, inertial=model)), 3).recording
    assert np.abs(recording.dead_reckoning[-1, :2] - recording.truth[-1, :2]).max() > 0.2
    said, true = (
        np.hypot(*np.diff(poses[:, :2], axis=0).T) for poses in (recording.dead_reckoning, recording.truth)
    )
    np.testing.assert_allclose(said, true, atol=0.01)


def test_the_driver_is_slower_on_rough_and_on_tilted_ground():
    def speed(tilt, roughness):
        driver = Driver(ROUTE, BUSY, np.random.default_rng(0))
        wanted = driver.command(0.0, (1.0, 1.0, 0.0), tilt, roughness)
        assert not isinstance(wanted, str)
        return wanted[0]

    assert speed((0.0, 0.0), 0.0) == BUSY.speed
    assert speed((0.0, 0.0), 0.05) == pytest.approx(BUSY.speed / (1.0 + 0.05 * BUSY.caution))
    assert speed((0.03, 0.04), 0.01) == pytest.approx(speed((0.0, 0.0), 0.05))


ON_ONE_CORE = """
import os, sys
os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
sys.path[:0] = sys.argv[2:]
from test_record import FULL, Small, recording_npz, simulate
recording_npz.write(sys.argv[1], simulate(Small(FULL), 5).recording)
"""


@pytest.mark.skipif(not hasattr(os, "sched_setaffinity"), reason="this system cannot bind to one core")
def test_one_core_or_all_of_them_same_file(tmp_path):
    """With debris, a person and smoke in the world; another process, bound to one core."""
    one, every = tmp_path / "one.npz", tmp_path / "every.npz"
    here = Path(__file__).resolve()
    words = [sys.executable, "-c", ON_ONE_CORE, str(one), str(here.parent), str(here.parents[2])]
    subprocess.run(words, check=True)
    recording_npz.write(every, simulate(Small(FULL), 5).recording)
    assert one.read_bytes() == every.read_bytes()
