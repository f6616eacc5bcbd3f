"""The robot: how it drives, collides and tilts."""

from __future__ import annotations

import numpy as np
import pytest

from sim.floorplan import box, wall
from sim.robot import Robot, RobotConfig, Tilt
from sim.terrain import Terrain
from sim.world import World

LEVEL = Terrain.level([-5.0, -5.0], [15.0, 5.0], 0.1)
DT = 0.01


def driven(world, seconds, speed, turn_rate=0.0, start=(0.0, 0.0, 0.0)):
    robot, rng = Robot(world, start, RobotConfig()), np.random.default_rng(0)
    tracks = robot.config.track_speeds(speed, turn_rate)
    impulse = 0.0
    for _ in range(round(seconds / DT)):
        robot.step(*tracks, DT, rng)
        impulse = max(impulse, robot.impulse)
    return robot, impulse


def test_straight_on_at_the_commanded_speed():
    robot, impulse = driven(World((), LEVEL), 5.0, 0.6)
    x, y, yaw = robot.pose
    assert x == pytest.approx(3.0, abs=0.06)
    assert (y, yaw) == pytest.approx((0.0, 0.0), abs=1e-9)
    assert impulse == 0.0


def test_turns_on_the_spot_at_the_commanded_rate():
    robot, _ = driven(World((), LEVEL), 4.0, 0.0, 0.5)
    x, y, yaw = robot.pose
    assert yaw == pytest.approx(2.0, rel=0.05)
    assert np.hypot(x, y) < 0.02


def test_stops_at_a_wall_and_feels_it():
    world = World(tuple(wall([2.0, -2.0], [2.0, 2.0], thickness=0.2)), LEVEL)
    robot, impulse = driven(world, 6.0, 0.6)
    assert robot.pose[0] + 0.5 * robot.config.length == pytest.approx(1.9, abs=0.03)
    assert impulse > 5.0


@pytest.mark.parametrize(("z_lo", "z_hi", "stops"), [(0.36, 0.6, True), (0.6, 0.8, False), (-1, 0.05, False)])
def test_furniture_stops_it_only_at_its_own_height(z_lo, z_hi, stops):
    robot, _ = driven(World((box([2.0, 0, 0], 0.5, 2.0, z_lo, z_hi),), LEVEL), 6.0, 0.6)
    assert (robot.pose[0] < 1.8) == stops


def test_a_ramp_tilts_the_nose_up_and_a_side_slope_the_left():
    x, y = LEVEL.nodes()
    ground = Terrain(0.1 * x + 0.05 * y, np.zeros_like(x), LEVEL.origin, LEVEL.resolution)
    robot, _ = driven(World((), ground), 2.0, 0.0)
    _, _, _, roll, pitch, height = robot.state
    assert pitch == pytest.approx(-np.arctan(0.1), abs=1e-3)
    assert roll == pytest.approx(np.arctan(0.05), abs=1e-3)
    assert height == pytest.approx(0.1 * robot.pose[0] + 0.05 * robot.pose[1], abs=1e-3)


def test_a_fall_from_a_ledge_is_felt_and_driving_over_a_sill_is_not():
    """Free fall to the ground's height ends in m √(2 g h) at most: 24 kg, 0.3 m: 58 N s."""
    ledge = Terrain.level([-1, -1], [5, 1], 0.05).with_ramp([0.5, 0.0], [1.5, 0.0], 1.0, 0.3)
    robot, impulse = driven(World((), ledge), 8.0, 0.4)
    assert robot.state[5] == 0.0
    assert 14.0 < impulse < 58.0
    sill = Terrain.level([-1, -1], [5, 1], 0.05).with_sill([1.0, -0.5], [1.0, 0.5], 0.06, 0.25)
    _, impulse = driven(World((), sill), 8.0, 0.4)
    assert impulse < 14.0


def test_tilt_overshoots_as_a_second_order_system():
    """ζ = 0.4: overshoot exp(-πζ/√(1-ζ²)) = 25 % at t = π/(ω √(1-ζ²)) = 0.286 s."""
    tilt, path = Tilt(12.0, 0.4, 0.0), []
    for _ in range(2000):
        tilt.step(1.0, 0.0, 0.001)
        path.append(tilt.angle)
    assert max(path) == pytest.approx(1.254, abs=0.01)
    assert np.argmax(path) * 0.001 == pytest.approx(0.286, abs=0.01)
    assert path[-1] == pytest.approx(1.0, abs=1e-3)


def test_rubble_shakes_by_the_stated_deviation():
    tilt, rng, path = Tilt(12.0, 0.4, 0.0), np.random.default_rng(0), []
    for shake in 0.05 * rng.standard_normal(60_000):
        tilt.step(0.0, shake, 0.005)
        path.append(tilt.angle)
    assert np.std(path) == pytest.approx(0.05, rel=0.08)


def test_a_robot_at_rest_on_rubble_is_not_shaken():
    rough = Terrain(LEVEL.heights, np.full(LEVEL.heights.shape, 0.05), LEVEL.origin, LEVEL.resolution)
    at_rest, _ = driven(World((), rough), 1.0, 0.0)
    moving, _ = driven(World((), rough), 1.0, 0.6)
    assert abs(at_rest.state[4]) < 1e-6
    assert abs(moving.state[4]) > 1e-3
