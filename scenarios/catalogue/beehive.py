"""A beehive: nineteen hexagonal rooms, after figure 3.3 of Formsma's thesis.

Its walls run in three directions, so its Hough spectrum has three peaks, 60 degrees apart: every rotation by
60 degrees looks right to the spectrum, and a room looks like itself turned. Only what stands in the rooms and
which doors are open tell. Sills and heaps of rubble tilt the robot on its way round.
"""

from __future__ import annotations

from itertools import pairwise, product

import numpy as np

from scenarios.catalogue.building import PIECES, closed_doors, distance, start, walls, with_heaps, with_sills
from sim.driver import resample
from sim.floorplan import Prism
from sim.record import Setup
from sim.terrain import Terrain
from sim.world import World
from slam.se2 import Array

SIDE = 3.0
"""Of a room [m]."""
CELLS = tuple((q, r) for q in range(-2, 3) for r in range(-2, 3) if abs(q + r) <= 2)
"""The rooms, by axial coordinates."""
ROUTE = (
    *((0, 0), (1, 0), (2, 0), (2, -1), (2, -2), (1, -2), (1, -1), (1, 0)),
    *((0, 1), (0, 2), (-1, 2), (-2, 2), (-2, 1), (-1, 1), (0, 0)),
    *((0, -1), (-1, 0), (-2, 1), (-1, 1), (0, 1), (1, 0), (0, 0)),
)
"""Rooms in the order of the drive: two petals that share the middle, then across both once more."""
CEILING = 2.5
CLEARANCE = 0.4
SHARE_CLOSED = 0.5
"""Of the doors that the route does not use."""
HEAPS = 8
FEWEST, MOST = 1, 3
"""Pieces of furniture in a room."""


def build(rng: np.random.Generator) -> Setup:
    """One beehive: which way round it is driven, open doors, furniture and rubble are drawn from ``rng``."""
    route = draw_route(rng)
    doors = _doors()
    keep_clear = np.vstack([resample(route), doors[:, :2]])
    prisms = [*walls(_segments(), doors), *closed_doors(doors, route, SHARE_CLOSED, rng)]
    for cell in CELLS:
        prisms += _furniture(centre(cell), keep_clear, rng)
    reach = 2.5 * np.sqrt(3.0) * SIDE
    terrain = Terrain.level([-reach - 0.5, -4.0 * SIDE - 0.5], [reach + 0.5, 4.0 * SIDE + 0.5])
    terrain = with_heaps(with_sills(terrain, doors, rng), route, HEAPS, rng)
    return Setup(World(tuple(prisms), terrain, CEILING), start(route), route)


def centre(cell: tuple[int, int]) -> Array:
    """Middle (2) m of a room; the middle room is at the origin."""
    q, r = cell
    return SIDE * np.array([np.sqrt(3.0) * (q + 0.5 * r), 1.5 * r])


def draw_route(rng: np.random.Generator) -> Array:
    """Waypoints ``(K, 2)`` m through the rooms of the route, turned by a multiple of 60 degrees."""
    cells = list(ROUTE)
    for _ in range(rng.integers(6)):
        cells = [(-r, q + r) for q, r in cells]
    spots = np.array([centre(cell) for cell in cells]) + rng.uniform(-0.6, 0.6, (len(cells), 2))
    waypoints = [spots[0]]
    for (a, b), spot in zip(pairwise(cells), spots[1:], strict=True):
        door, through = 0.5 * (centre(a) + centre(b)), centre(b) - centre(a)
        through /= np.hypot(*through)
        waypoints += [door - 0.6 * through, door + 0.6 * through, spot]
    return np.array(waypoints)


def _segments() -> list[tuple[float, float, float, float]]:
    """Every side of every room once."""
    sides = {}
    for cell in CELLS:
        corners = centre(cell) + SIDE * _directions(30.0)
        for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
            middle = 0.5 * (a + b)
            sides[round(float(middle[0]), 3) + 0.0, round(float(middle[1]), 3) + 0.0] = (*a, *b)
    return list(sides.values())


def _doors() -> Array:
    """A door ``(K, 3)`` (x, y, yaw of its wall) in every wall between two rooms."""
    doors = []
    for (q, r), (dq, dr) in product(CELLS, ((1, 0), (0, 1), (-1, 1))):
        if (q + dq, r + dr) in CELLS:
            a, b = centre((q, r)), centre((q + dq, r + dr))
            doors.append([*(0.5 * (a + b)), float(np.arctan2(*(b - a)[::-1])) + 0.5 * np.pi])
    return np.array(doors)


def _directions(first: float) -> Array:
    """Unit vectors ``(6, 2)``, 60 degrees apart, the first at ``first`` degrees."""
    angles = np.deg2rad(first) + np.pi / 3.0 * np.arange(6)
    return np.stack([np.cos(angles), np.sin(angles)], -1)


def _furniture(middle: Array, keep_clear: Array, rng: np.random.Generator) -> list[Prism]:
    """Pieces in some of a room's corners."""
    prisms: list[Prism] = []
    for corner in rng.permutation(6)[: rng.integers(FEWEST, MOST + 1)]:
        kind = rng.choice(["cupboard", "trolley", "crate", "chair"])
        x, y = middle + 0.72 * SIDE * _directions(30.0)[corner]
        pose = np.array([x, y, rng.uniform(-np.pi, np.pi)])
        if distance(pose, PIECES[kind].size, keep_clear) > CLEARANCE:
            prisms += PIECES[kind].make(pose)
    return prisms
