"""The scanner on its robot: where it sits, what it reports, and what of the world it is told to ignore."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sim.floorplan import box
from sim.laser import Raycaster, Scanner
from sim.laser_effects import Effects
from sim.terrain import Terrain
from sim.world import World

OPEN = World((), Terrain.level([-10, -10], [10, 10], 0.5))


def test_the_laser_sits_behind_the_centre_and_leans_with_the_robot():
    scanner = Scanner(mount=(-0.08, 0.0, 0.0), height=0.30)
    level = scanner.sensor_poses([[1.0, 2.0, np.pi / 2, 0.0, 0.0, 0.1]])[0]
    np.testing.assert_allclose(level, [1.0, 1.92, np.pi / 2, 0.0, 0.0, 0.4], atol=1e-12)
    theta = 0.2
    leaning = scanner.sensor_poses([[0.0, 0.0, 0.0, 0.0, theta, 0.0]])[0]
    assert leaning[0] == pytest.approx(-0.08 * np.cos(theta) + 0.3 * np.sin(theta))
    assert leaning[5] == pytest.approx(0.08 * np.sin(theta) + 0.3 * np.cos(theta))


def test_a_scan_reports_what_the_laser_sees():
    """In the middle of a 4 m room, without effects: the walls' ranges, in front 2 m and 8 cm more."""
    room = [
        box([2.1, 0, 0], 0.2, 5),
        box([-2.1, 0, 0], 0.2, 5),
        box([0, 2.1, 0], 5, 0.2),
        box([0, -2.1, 0], 5, 0.2),
    ]
    still = Effects(mixed_pixels=False, dropouts=False, noise=False, quantisation=False)
    scanner = Scanner(beams=5, field_of_view=np.pi, effects=still)
    scan = scanner.scan(
        Raycaster(World(tuple(room), OPEN.terrain)), np.zeros((1, 6)), np.random.default_rng(0)
    )
    np.testing.assert_allclose(scan[0, [0, 2, 4]], [2.0, 2.08, 2.0], atol=1e-12)


QUIET = Effects(mixed_pixels=False, dropouts=False, noise=False, quantisation=False)
LOW = World((box([2.25, 0, 0], 1.5, 2.0, z_hi=0.2), box([4.0, 0, 0], 1.0, 9.0)), OPEN.terrain)


@pytest.mark.parametrize(
    ("pitch", "off", "expected"),
    [
        (0.0, {}, 3.5),  # level: over the low box, to the wall behind it
        (0.05, {}, 0.1 / np.sin(0.05)),  # nose down: onto its top
        (0.05, {"tilt": False}, 3.5),
        (0.05, {"heights": False}, 1.5 / np.cos(0.05)),  # nothing is low: its front
        (0.0, {"heights": False}, 1.5),
        (0.3, {}, 0.3 / np.sin(0.3)),  # steeply down: the floor before it
        (0.3, {"floor": False}, 1.5 / np.cos(0.3)),
        (0.3, {"floor": False, "heights": False}, 1.5 / np.cos(0.3)),
        (0.3, {"tilt": False, "heights": False}, 1.5),
    ],
)
def test_geometry_has_switches(pitch, off, expected):
    scanner = Scanner(1, 0.0, mount=(0.0, 0.0, 0.0), range_max=9.0, effects=replace(QUIET, **off))
    height = scanner.height * np.cos(pitch)
    robot = np.array([[-scanner.height * np.sin(pitch), 0, 0, 0, pitch, scanner.height - height]])
    if not scanner.effects.tilt:
        robot[0, [0, 5]] = 0.0
    scan = scanner.scan(scanner.caster(LOW), robot, np.random.default_rng(0))
    assert scan[0, 0] == pytest.approx(expected)
