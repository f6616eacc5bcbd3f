"""Things that move, as the laser sees them: against the caster of the still world, and by hand."""

from __future__ import annotations

import numpy as np
import pytest

from sim.floorplan import Prism, box, stone
from sim.laser import MovingObstacles, Raycaster, Scanner
from sim.laser_effects import Effects
from sim.terrain import Terrain
from sim.world import Debris, Person, World
from slam import se2

LEVEL = Terrain.level([-10.0, -10.0], [10.0, 10.0], 0.5)
ANGLES = np.linspace(-2.0, 2.0, 81)
REACH = 6.0


def nothing(poses):
    return np.full((len(poses), len(ANGLES)), np.nan), np.ones((len(poses), len(ANGLES)))


def placed(prism, pose):
    return Prism(se2.transform(pose, prism.footprint), prism.z_lo, prism.z_hi)


@pytest.mark.parametrize("tilt", [0.0, 0.15])
def test_movers_look_like_still_solids_in_the_same_place(tilt):
    """Twin: for each scan a still world with every mover where it is at that moment."""
    rng = np.random.default_rng(3)
    debris = [Debris(stone(rng.uniform(-1, 1, 2), 0.4, 0.35, rng), 1.0) for _ in range(12)]
    floating = [Debris(box([0, 0, 0], 0.8, 0.4, 0.32, 0.4), 1.0) for _ in range(6)]
    world = World((), LEVEL, debris=(*debris, *floating))
    count, scans = len(world.debris), 25
    movers = np.dstack([rng.uniform(-4, 4, (scans, count, 2)), rng.uniform(-4, 4, (scans, count))])
    poses = np.column_stack([rng.uniform(-1, 1, (scans, 2)), rng.uniform(-4, 4, scans)])
    poses = np.hstack([poses, rng.uniform(-tilt, tilt, (scans, 2)), np.full((scans, 1), 0.3)])
    movers_in_view = MovingObstacles.on_ground(world.movers, movers, LEVEL)
    ranges, cosines = movers_in_view.cast(poses, ANGLES, REACH, *nothing(poses))
    for n in range(scans):
        still = [placed(d.shape, pose) for d, pose in zip(world.debris, movers[n], strict=True)]
        caster = Raycaster(World(tuple(still), LEVEL), floor=False)
        expected, incidence = caster.cast_with_incidence(poses[n : n + 1], ANGLES, REACH)
        np.testing.assert_allclose(ranges[n], expected[0], atol=1e-9)
        met = np.isfinite(expected[0]) & (expected[0] > 0.0)
        np.testing.assert_allclose(cosines[n, met], incidence[0, met], atol=1e-9)
    assert np.isfinite(ranges).mean() > 0.3


def test_the_nearer_of_wall_and_mover_counts():
    movers_in_view = MovingObstacles.on_ground(
        World((), LEVEL, debris=(Debris(box([0, 0, 0], 1, 1), 1.0),)).movers, [[[3.0, 0.0, 0.0]]], LEVEL
    )
    pose, still = np.array([[0, 0, 0, 0, 0, 0.3]]), np.array([[2.0, 4.0, np.nan]])
    ranges, cosines = movers_in_view.cast(pose, np.zeros(3), REACH, still, np.full((1, 3), 0.5))
    np.testing.assert_allclose(ranges, [[2.0, 2.5, 2.5]])
    np.testing.assert_allclose(cosines, [[0.5, 1.0, 1.0]])
    np.testing.assert_array_equal(still, [[2.0, 4.0, np.nan]])
    within, _ = movers_in_view.cast(pose, np.zeros(3), 2.6, still, np.ones((1, 3)))
    np.testing.assert_allclose(within, [[2.0, 2.5, 2.5]])
    beyond, _ = movers_in_view.cast(pose, np.zeros(3), 2.4, still, np.ones((1, 3)))
    np.testing.assert_array_equal(beyond, still)


def test_movers_stand_on_the_ground_under_them():
    """A crate 0.2 m high: a level beam at 0.3 m passes over it, but not when it lies on a platform."""
    ground = LEVEL.with_platform([2.0, -1.0], [4.0, 1.0], 0.15)
    crate = World((), ground, debris=(Debris(box([0, 0, 0], 0.4, 0.4, z_hi=0.2), 1.0),)).movers
    pose, angle = np.array([[0, 0, 0, 0, 0, 0.3]] * 2), np.zeros(1)
    movers_in_view = MovingObstacles.on_ground(crate, [[[1.0, 0.0, 0.0]], [[3.0, 0.0, 0.0]]], ground)
    none = np.full((2, 1), np.nan)
    np.testing.assert_allclose(movers_in_view.cast(pose, angle, REACH, none, none)[0], [[np.nan], [2.8]])
    endless = movers_in_view.without_heights()
    np.testing.assert_allclose(endless.cast(pose, angle, REACH, none, none)[0], [[0.8], [2.8]])


def test_a_scan_shows_movers_and_honours_the_switch_of_heights():
    quiet = Effects(mixed_pixels=False, dropouts=False, noise=False, quantisation=False)
    person = Person(np.array([[0.0, 0.0], [1.0, 0.0]]), radius=0.2)
    low = Debris(box([0, 0, 0], 0.4, 0.4, z_hi=0.2), 1.0)
    world = World((), LEVEL, debris=(low,), people=(person,))
    movers = MovingObstacles.on_ground(world.movers, [[[1.0, 0.0, 0.0], [3.0, 0.0, 0.0]]], LEVEL)
    for effects, expected in ((quiet, 2.8), (Effects(**{**vars(quiet), "heights": False}), 0.8)):
        scanner = Scanner(1, 0.0, mount=(0.0, 0.0, 0.0), effects=effects)
        scan = scanner.scan(scanner.caster(world), np.zeros((1, 6)), np.random.default_rng(0), movers=movers)
        assert scan[0, 0] == pytest.approx(expected)
