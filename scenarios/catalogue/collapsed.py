"""A collapsed building: rubble everywhere, slabs to climb and fall from, walls with pieces missing.

The robot is never level: the laser draws the floor as often as the walls, passes over stones and under what
hangs, and every fall from a slab upsets the yaw of the INS. Loose blocks give way when pushed. Failure is
the rule here, not the exception: how much of a map can be saved?
"""

from __future__ import annotations

from itertools import pairwise, product

import numpy as np
from scipy.spatial import cKDTree

from scenarios.catalogue.building import jittered, rectangle, start, stones, walls
from sim.driver import resample
from sim.floorplan import Prism, box
from sim.record import Setup
from sim.terrain import Terrain
from sim.world import Debris, World
from slam.se2 import Array

Room = tuple[int, int]
Pair = tuple[Room, Room]

LENGTH, DEPTH = 28.0, 22.0
COLUMNS, ROWS = 4, 3
"""Of rooms."""
ROOM = (LENGTH / COLUMNS, DEPTH / ROWS)
ROUTE = (
    *((0, 0), (1, 0), (2, 0), (3, 0), (3, 1), (3, 2), (2, 2), (1, 2)),
    *((0, 2), (0, 1), (1, 1), (2, 1), (2, 0), (1, 0), (1, 1), (0, 1), (0, 0)),
)
"""Rooms (column, row) in the order of the drive."""
GAP = 2.4
"""Width of what was broken out of an inner wall where the route leads through [m]."""
SHARE_OPEN = 0.4
"""Of the walls that the route does not pass."""
CEILING = 2.5
CLEARANCE = 0.45
STONES, BLOCKS, BEAMS = 140, 14, 10
"""Stones, loose blocks on the route's edge, and hanging beams."""
SLABS, SLAB_LENGTH, SLAB_WIDTH, SLAB_RISE = 4, 1.6, 1.2, (0.25, 0.45)
"""Number, length, width and rise [m] of the slabs on the route."""
RUBBLE, ROUGHNESS = 0.03, np.deg2rad(3.0)
HEAPS, HEAP_HEIGHT, HEAP_RADIUS = 30, (0.04, 0.09), (0.6, 1.3)


def build(rng: np.random.Generator) -> Setup:
    """One ruin: gaps, stones, slabs, rubble and the exact route drawn from ``rng``."""
    gaps = _gaps(rng)
    route = draw_route(gaps, rng)
    path = resample(route)
    low, high = np.zeros(2), np.array([LENGTH, DEPTH])
    used = {(min(pair), max(pair)) for pair in pairwise(ROUTE)}
    opened = np.array([gap for pair, gap in gaps.items() if pair in used or rng.random() < SHARE_OPEN])
    inner = [(ROOM[0] * i, 0.0, ROOM[0] * i, DEPTH) for i in range(1, COLUMNS)]
    inner += [(0.0, ROOM[1] * j, LENGTH, ROOM[1] * j) for j in range(1, ROWS)]
    prisms = walls([*rectangle(0.0, 0.0, LENGTH, DEPTH), *inner], opened, GAP)
    prisms += stones(low + 0.3, high - 0.3, STONES, (0.12, 0.5), (0.12, 0.9), path, CLEARANCE, rng)
    prisms += _beams(rng)
    blocks = stones(low + 0.3, high - 0.3, 40 * BLOCKS, (0.1, 0.2), (0.2, 0.5), path, 0.1, rng)
    near = [b for b in blocks if _distance(path, b) < 0.35 and _distance(path[:40], b) > 0.5]
    debris = tuple(Debris(block, mass=rng.uniform(2.0, 6.0)) for block in near[:BLOCKS])
    world = World(tuple(prisms), _ground(path, rng), CEILING, debris=debris)
    return Setup(world, start(route), route)


def draw_route(gaps: dict[Pair, Array], rng: np.random.Generator) -> Array:
    """Waypoints ``(K, 2)`` m through the gaps between the rooms of the route."""
    spots = jittered([(np.array(room) + 0.5) * ROOM for room in ROUTE], 0.9, rng)
    waypoints = [spots[0]]
    for (a, b), spot in zip(pairwise(ROUTE), spots[1:], strict=True):
        through = 0.6 * np.array([b[0] - a[0], b[1] - a[1]])
        gap = gaps[min(a, b), max(a, b)] + rng.uniform(-0.15, 0.15, 2)
        waypoints += [gap - through, gap + through, spot]
    return np.array(waypoints)


def _gaps(rng: np.random.Generator) -> dict[Pair, Array]:
    """Middle (2) m of what is broken out of the wall between any two rooms."""
    gaps = {}
    for i, j in product(range(COLUMNS), range(ROWS)):
        x, y = (i + 0.5) * ROOM[0], (j + 0.5) * ROOM[1]
        aside = rng.uniform(-1.2, 1.2, 2)
        if i + 1 < COLUMNS:
            gaps[(i, j), (i + 1, j)] = np.array([(i + 1) * ROOM[0], y + aside[0]])
        if j + 1 < ROWS:
            gaps[(i, j), (i, j + 1)] = np.array([x + aside[1], (j + 1) * ROOM[1]])
    return gaps


def _beams(rng: np.random.Generator) -> list[Prism]:
    """What hangs from the ceiling, too high to stop the robot; a laser that looks up meets it."""
    beams = []
    for _ in range(BEAMS):
        place, yaw = rng.uniform([1.5, 1.5], [LENGTH - 1.5, DEPTH - 1.5]), rng.uniform(-np.pi, np.pi)
        beams.append(box([*place, yaw], rng.uniform(1.0, 2.5), 0.3, 0.6, rng.uniform(0.8, 1.4)))
    return beams


def _ground(path: Array, rng: np.random.Generator) -> Terrain:
    """Rubble all over, heaps of it on and off the route, and slabs to climb along the route."""
    terrain = Terrain.level([-0.5, -0.5], [LENGTH + 0.5, DEPTH + 0.5])
    terrain = terrain.with_rubble_field([0.0, 0.0], [LENGTH, DEPTH], RUBBLE, ROUGHNESS, rng)
    for k in range(HEAPS):
        place = path[rng.integers(len(path))] if k % 2 else rng.uniform([0.0, 0.0], [LENGTH, DEPTH])
        radius, height = rng.uniform(*HEAP_RADIUS), rng.uniform(*HEAP_HEIGHT)
        terrain = terrain.with_rubble(place, radius, height, ROUGHNESS, rng)
    # a slab begins where nothing comes back to its end, too high to climb
    steps, near = round(SLAB_LENGTH / 0.05), cKDTree(path).query_ball_point(path, SLAB_WIDTH)
    once = np.array([max(at) - min(at) < 4 * steps for at in near])
    begins = np.flatnonzero([once[at : at + steps + 10].all() for at in range(len(path) - steps)])
    for at in rng.choice(begins, SLABS, replace=False):
        terrain = terrain.with_ramp(path[at], path[at + steps], SLAB_WIDTH, rng.uniform(*SLAB_RISE))
    return terrain


def _distance(path: Array, block: Prism) -> float:
    """Smallest distance [m] from the route to the middle of a block."""
    return float(np.hypot(*(path - block.footprint.mean(axis=0)).T).min())
