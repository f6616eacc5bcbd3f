"""The physics around the robot: debris that slides, people who walk."""

from __future__ import annotations

import numpy as np
import pytest

from sim.floorplan import box, wall
from sim.physics import GRAVITY, PhysicsWorld
from sim.robot import Robot, RobotConfig
from sim.terrain import Terrain
from sim.world import Debris, Person, World

LEVEL = Terrain.level([-5.0, -5.0], [15.0, 5.0], 0.1)
DT = 0.01
AWAY = (-50.0, 0.0)


def crate(x, y=0.0, mass=4.0, friction=0.5):
    return Debris(box([x, y, 0.0], 0.3, 0.3, z_hi=0.4), mass, friction)


def driven(world, seconds, speed=0.6):
    robot, rng = Robot(world, (0.0, 0.0, 0.0), RobotConfig()), np.random.default_rng(0)
    for _ in range(round(seconds / DT)):
        robot.step(speed, speed, DT, rng)
    return robot


def test_a_crate_is_pushed_along_and_slows_the_robot():
    """Robot 0.4 m and crate 0.3 m long: pushed square on, their centres stay 0.35 m apart."""
    robot = driven(World((), LEVEL, debris=(crate(2.0),)), 6.0)
    free = driven(World((), LEVEL), 6.0)
    assert robot.movers[0][0] - robot.pose[0] == pytest.approx(0.35, abs=0.01)
    assert robot.movers[0][0] > 2.8
    assert robot.pose[0] < free.pose[0]


def test_a_crate_that_is_out_of_the_way_stays():
    robot = driven(World((), LEVEL, debris=(crate(2.0, 1.0),)), 6.0)
    assert robot.movers[0] == pytest.approx((2.0, 1.0, 0.0), abs=1e-9)


def test_a_crate_hit_off_its_centre_turns():
    robot = driven(World((), LEVEL, debris=(crate(1.0, 0.2),)), 3.0)
    assert abs(robot.movers[0][2]) > 0.05


@pytest.mark.parametrize(("mass", "stalls"), [(30.0, False), (60.0, True)])
def test_debris_heavier_than_the_tracks_can_push_stalls_the_robot(mass, stalls):
    """The tracks pull with at most 0.8 · 24 kg · g; friction of 0.6 on the debris holds 32 kg against it."""
    robot = driven(World((), LEVEL, debris=(crate(1.0, mass=mass, friction=0.6),)), 6.0)
    assert (robot.pose[0] < 0.8) == stalls


def test_debris_slides_to_a_stop_under_friction():
    """From 1 m/s with μ = 0.5: v² / 2 μ g = 0.102 m, after v / μ g = 0.20 s."""
    around = PhysicsWorld(World((), LEVEL, debris=(crate(0.0),)), 0.08, 0.45)
    body = next(body for body in around.space.bodies if body.mass == 4.0)
    body.velocity = (1.0, 0.0)
    for _ in range(50):
        around.step(AWAY, DT)
    assert around.movers[0][0] == pytest.approx(1.0 / (2.0 * 0.5 * GRAVITY), abs=0.006)
    assert body.velocity.length < 1e-9


def test_debris_below_the_robots_step_does_not_stop_it():
    low = Debris(box([1.0, 0.0, 0.0], 0.3, 0.3, z_hi=0.05), 500.0)
    assert driven(World((), LEVEL, debris=(low,)), 4.0).pose[0] > 2.0


def test_debris_stops_at_a_wall():
    walls = tuple(wall([2.0, -2.0], [2.0, 2.0], thickness=0.2))
    robot = driven(World(walls, LEVEL, debris=(crate(1.0),)), 6.0)
    assert robot.movers[0][0] == pytest.approx(1.9 - 0.15, abs=0.03)
    assert robot.pose[0] == pytest.approx(1.9 - 0.3 - 0.2, abs=0.05)


def test_people_come_after_debris_and_walk_at_their_speed():
    person = Person(np.array([[3.0, -2.0], [3.0, 2.0]]), speed=1.2)
    around = PhysicsWorld(World((), LEVEL, debris=(crate(9.0),), people=(person,)), 0.08, 0.45)
    for _ in range(150):
        around.step(AWAY, DT)
    assert around.movers[0] == pytest.approx((9.0, 0.0, 0.0), abs=1e-9)
    assert around.movers[1] == pytest.approx((3.0, -0.2, np.pi / 2))
    for _ in range(250):  # 4.8 m in all: 0.8 m on the way back
        around.step(AWAY, DT)
    assert around.movers[1] == pytest.approx((3.0, 1.2, -np.pi / 2))


def test_a_person_kicks_debris_along():
    person = Person(np.array([[-2.0, 0.0], [4.0, 0.0]]), speed=1.0)
    around = PhysicsWorld(World((), LEVEL, debris=(crate(0.0),), people=(person,)), 0.08, 0.45)
    for _ in range(400):
        around.step(AWAY, DT)
    assert around.movers[0][0] > 2.2
    assert around.movers[1][0] == pytest.approx(2.0)


def test_a_robot_in_the_way_makes_a_person_turn_round():
    person = Person(np.array([[2.0, 0.0], [-2.0, 0.0], [-2.0, 3.0], [2.0, 3.0]]), keep_off=0.8)
    robot = driven(World((), LEVEL, people=(person,)), 4.0, speed=0.0)
    assert robot.pose == (0.0, 0.0, 0.0)
    assert robot.movers[0][1] > 0.1
