"""Under the open sky: trees, rocks and irregular hedges on hilly ground (§6.2.3 of Formsma's thesis).

There are no straight walls, so the Hough transform finds no lines and its spectrum no peaks: rotation must
come from elsewhere. Slopes tilt the laser, which passes over the low rocks or draws the hillside; people walk
about. The thesis expects its method to fail here.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from scenarios.catalogue.building import start, stones, with_heaps
from sim.driver import resample
from sim.floorplan import Prism, column, stone
from sim.record import Setup
from sim.terrain import Terrain
from sim.world import Person, World
from slam.se2 import Array

LENGTH, DEPTH = 50.0, 40.0
"""Of the ground inside the hedge [m]."""
HEDGE = (0.5, 0.9)
"""Half thickness of the hedge, drawn anew every metre [m]."""
TREES, ROCKS, HEDGES, WALKERS, HEAPS = 50, 70, 5, 3, 10
TRUNK = (0.1, 0.4)
"""Radius of a tree [m]."""
HILLS, HILL = 0.2, 3.0
"""Typical height of the hills, and their size [m]."""
LAPS = 1.15
"""Of the figure of eight that is driven."""
CLEARANCE = 0.6


def build(rng: np.random.Generator) -> Setup:
    """One piece of ground: what grows and lies there, the hills and the exact route drawn from ``rng``."""
    route = draw_route(rng)
    path = resample(route)
    low, high = np.zeros(2), np.array([LENGTH, DEPTH])
    prisms = _hedge(_outline(rng), rng)
    for _ in range(HEDGES):
        prisms += _clear_of(path, _hedge(_bow(rng), rng))
    inner = low + 2.0, high - 2.0
    trunks = [column(rng.uniform(*inner), rng.uniform(*TRUNK), 8, height=4.0) for _ in range(TREES)]
    prisms += _clear_of(path, trunks)
    prisms += stones(low + 1.0, high - 1.0, ROCKS, (0.15, 0.7), (0.15, 0.9), path, CLEARANCE, rng)
    terrain = Terrain.level(low - 2.0, high + 2.0, 0.1)
    terrain = terrain.with_rubble_field(low - 1.0, high + 1.0, HILLS, 0.0, rng, grain=HILL)
    terrain = with_heaps(terrain, route, HEAPS, rng)
    people = tuple(_walker(path, rng) for _ in range(WALKERS))
    return Setup(World(tuple(prisms), terrain, people=people), start(route), route)


def draw_route(rng: np.random.Generator) -> Array:
    """Waypoints ``(K, 2)`` m along a figure of eight, a little more than once round."""
    phase = rng.uniform(0.0, 2.0 * np.pi)
    t = phase + 2.0 * np.pi * np.linspace(0.0, LAPS, int(40 * LAPS))
    drift = rng.uniform(-0.5, 0.5, (2, 2))
    x = 0.5 * LENGTH + 19.0 * np.sin(t) + drift[0, 0] * np.sin(0.5 * t)
    y = 0.5 * DEPTH + 13.0 * np.sin(2.0 * t) + drift[1, 0] * np.cos(0.5 * t)
    return np.stack([x, y], -1) + rng.uniform(-0.1, 0.1, (len(t), 2))


def _outline(rng: np.random.Generator) -> Array:
    """Corners of the hedge around everything: a wavy rectangle, closed."""
    sides = resample([[0.0, 0.0], [LENGTH, 0.0], [LENGTH, DEPTH], [0.0, DEPTH], [0.0, 0.0]], spacing=0.9)
    waves = 0.5 * np.stack([np.sin(0.7 * sides[:, 1]), np.sin(0.5 * sides[:, 0])], -1)
    return sides + waves + rng.uniform(-0.25, 0.25, sides.shape)


def _bow(rng: np.random.Generator) -> Array:
    """Points of a bent hedge somewhere inside."""
    centre = rng.uniform([8.0, 8.0], [LENGTH - 8.0, DEPTH - 8.0])
    angles = rng.uniform(-np.pi, np.pi) + np.arange(0.0, rng.uniform(1.0, 2.0), 0.25)
    return centre + rng.uniform(3.0, 5.0) * np.stack([np.cos(angles), np.sin(angles)], -1)


def _hedge(points: Array, rng: np.random.Generator) -> list[Prism]:
    """A bush at each of the points, higher than the laser and as wide as they are apart."""
    return [stone(point, rng.uniform(*HEDGE), rng.uniform(1.0, 1.8), rng) for point in points]


def _clear_of(path: Array, prisms: list[Prism]) -> list[Prism]:
    """Those that stand clear of the route."""
    route = cKDTree(path)
    marks = [np.vstack([p.footprint, p.footprint.mean(axis=0)]) for p in prisms]
    return [p for p, m in zip(prisms, marks, strict=True) if route.query(m)[0].min() > CLEARANCE]


def _walker(path: Array, rng: np.random.Generator) -> Person:
    """Somebody who walks to and fro across the route; turns well off it, so as not to stand in the way."""
    at = rng.integers(100, len(path) - 1)
    ahead = (path[at + 1] - path[at]) / np.hypot(*(path[at + 1] - path[at]))
    way = rng.uniform(2.5, 4.0) * np.array([-ahead[1], ahead[0]])
    return Person(np.array([path[at] - way, path[at] + way]), speed=rng.uniform(0.8, 1.4), start=rng.random())
