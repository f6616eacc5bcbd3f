"""What scenarios in buildings share: walls with doors, their leaves and sills, and rubble on the route."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from sim.driver import resample
from sim.floorplan import Door, Prism, box, wall
from sim.terrain import Terrain
from slam.se2 import Array

DOOR = 1.0
"""Width of a door [m]."""
SILL_HEIGHT, SILL_DEPTH = (0.02, 0.07), 0.25
RUBBLE_HEIGHT, RUBBLE_RADIUS, RUBBLE_ROUGHNESS = (0.01, 0.03), (0.5, 1.0), np.deg2rad(2.0)


def rectangle(x0: float, y0: float, x1: float, y1: float) -> list[tuple[float, float, float, float]]:
    """The four sides of a rectangle as segments."""
    return [(x0, y0, x1, y0), (x1, y0, x1, y1), (x0, y1, x1, y1), (x0, y0, x0, y1)]


def walls(segments: ArrayLike, doors: ArrayLike, width: float = DOOR) -> list[Prism]:
    """Walls along ``segments (S, 4)`` m, open for ``width`` m wherever one of ``doors (K, >= 2)`` lies."""
    prisms: list[Prism] = []
    for x0, y0, x1, y1 in np.asarray(segments, dtype=np.float64):
        length = float(np.hypot(x1 - x0, y1 - y0))
        ux, uy = (x1 - x0) / length, (y1 - y0) / length
        openings = []
        for x, y, *_ in np.asarray(doors, dtype=np.float64):
            along, across = (x - x0) * ux + (y - y0) * uy, (y - y0) * ux - (x - x0) * uy
            if abs(across) < 0.05 and 0.0 < along < length:
                openings.append(Door(along, width))
        prisms += wall([x0, y0], [x1, y1], openings)
    return prisms


def closed_doors(
    doors: ArrayLike, route: Array, share: float, rng: np.random.Generator, width: float = DOOR
) -> list[Prism]:
    """Leaves in a ``share`` of those ``doors (K, 3)`` (x, y, yaw of the wall) that the route does not use."""
    path = resample(route)
    leaves = []
    for door in np.asarray(doors, dtype=np.float64):
        used = np.hypot(path[:, 0] - door[0], path[:, 1] - door[1]).min() < 0.5
        if not used and rng.random() < share:
            leaves.append(box(door, width, 0.04, kind="wall"))
    return leaves


def with_sills(
    terrain: Terrain, doors: ArrayLike, rng: np.random.Generator, height: tuple[float, float] = SILL_HEIGHT
) -> Terrain:
    """A sill in each of ``doors (K, 3)`` (x, y, yaw of the wall), of a height m drawn from a range."""
    for x, y, yaw in np.asarray(doors, dtype=np.float64):
        half = 0.5 * DOOR * np.array([np.cos(yaw), np.sin(yaw)])
        centre = np.array([x, y])
        terrain = terrain.with_sill(centre - half, centre + half, rng.uniform(*height), SILL_DEPTH)
    return terrain


def with_heaps(
    terrain: Terrain,
    route: Array,
    count: int,
    rng: np.random.Generator,
    height: tuple[float, float] = RUBBLE_HEIGHT,
    roughness: float = RUBBLE_ROUGHNESS,
) -> Terrain:
    """``count`` heaps of rubble on the route, their height m drawn from a range."""
    path = resample(route)
    for at in rng.choice(len(path), count, replace=False):
        bumps, radius = rng.uniform(*height), rng.uniform(*RUBBLE_RADIUS)
        terrain = terrain.with_rubble(path[at], radius, bumps, roughness, rng)
    return terrain


def spread(route: Array, count: int, rng: np.random.Generator) -> Array:
    """``count`` points ``(count, 2)`` m of the route, one somewhere in each of as many equal stretches."""
    path = resample(route)
    return path[((np.arange(count) + rng.random(count)) / count * len(path)).astype(int)]


def start(route: Array) -> tuple[float, float, float]:
    """The first waypoint, looking at the second."""
    dx, dy = route[1] - route[0]
    return float(route[0, 0]), float(route[0, 1]), float(np.arctan2(dy, dx))


def jittered(waypoints: Sequence[ArrayLike], by: float, rng: np.random.Generator) -> Array:
    """Waypoints ``(K, 2)`` m, each moved by up to ``by`` m along either axis."""
    points = np.array(waypoints, dtype=np.float64)
    return points + rng.uniform(-by, by, points.shape)
