"""What scenarios share: walls with doors, their leaves and sills, furniture, stones, rubble on the route."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial import cKDTree

from sim.driver import resample
from sim.floorplan import Door, Prism, bed, box, cupboard, desk, stone, table, wall
from sim.terrain import Terrain
from slam import se2
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
    again: bool = False,
) -> Terrain:
    """``count`` heaps of rubble on the route, their height m drawn from a range; on places that have one
    where ``again``."""
    path = resample(route)
    for at in rng.choice(len(path), count, replace=again):
        bumps, radius = rng.uniform(*height), rng.uniform(*RUBBLE_RADIUS)
        terrain = terrain.with_rubble(path[at], radius, bumps, RUBBLE_ROUGHNESS, rng)
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


TRIES = 12
"""Draws per piece before the room goes without it."""


@dataclass(frozen=True)
class Piece:
    """A kind of furniture: its ``size`` (length along the wall, depth) m, and one made at a pose (3,)."""

    size: tuple[float, float]
    make: Callable[[Array], list[Prism]]


PIECES = {
    "bed": Piece((2.0, 0.9), bed),
    "desk": Piece((1.4, 0.7), desk),
    "table": Piece((1.4, 0.7), table),
    "chair": Piece((0.45, 0.45), lambda pose: table(pose, 0.45, 0.45, 0.46)),
    "cupboard": Piece((1.0, 0.45), cupboard),
    "crate": Piece((0.6, 0.4), lambda pose: [box(pose, 0.6, 0.4, z_hi=0.24)]),
    "trolley": Piece((0.7, 0.35), lambda pose: [box(pose, 0.7, 0.35, z_hi=0.9)]),
}
"""A level laser at 0.3 m sees cupboard, trolley, the desk's drawers and the bed's legs; not the crate."""


@dataclass(frozen=True)
class Area:
    """A rectangle (x0, y0, x1, y1) m between walls."""

    x0: float
    y0: float
    x1: float
    y1: float

    @property
    def middle(self) -> tuple[float, float]:
        """x and y of its middle [m]."""
        return 0.5 * (self.x0 + self.x1), 0.5 * (self.y0 + self.y1)

    def touches(self, point: Sequence[float], margin: float = 0.05) -> bool:
        """True where x, y lies in the rectangle or on its edge."""
        x, y = point[:2]
        return self.x0 - margin < x < self.x1 + margin and self.y0 - margin < y < self.y1 + margin

    def against_wall(self, size: tuple[float, float], rng: np.random.Generator, gap: float = 0.1) -> Array:
        """A pose ``(3,)`` with the length of a piece along one of the four walls."""
        length, depth = size
        yaw = 0.5 * np.pi * rng.integers(4)
        along_x = bool(np.cos(yaw) ** 2 > 0.5)
        half_x, half_y = 0.5 * np.array([length, depth] if along_x else [depth, length])
        lower = np.array([self.x0 + half_x + gap, self.y0 + half_y + gap])
        upper = np.maximum(np.array([self.x1 - half_x - gap, self.y1 - half_y - gap]), lower)
        x, y = rng.uniform(lower, upper)
        if along_x:
            y = (lower, upper)[rng.integers(2)][1]
        else:
            x = (lower, upper)[rng.integers(2)][0]
        return np.array([x, y, yaw])


def furnish(
    area: Area, kinds: Iterable[str], keep_clear: Array, clearance: float, rng: np.random.Generator
) -> list[Prism]:
    """The named pieces against the area's walls, apart from each other and ``clearance`` m off points (P, 2).

    A piece that finds no room is left out.
    """
    placed: list[Prism] = []
    for kind in kinds:
        piece = PIECES[kind]
        for _ in range(TRIES):
            pose = area.against_wall(piece.size, rng)
            occupied = [resample(np.vstack([p.footprint, p.footprint[:1]]), 0.1) for p in placed]
            if distance(pose, piece.size, keep_clear) < clearance:
                continue
            if occupied and distance(pose, piece.size, np.vstack(occupied)) < 0.1:
                continue
            placed += piece.make(pose)
            break
    return placed


def distance(pose: Array, size: tuple[float, float], points: Array) -> float:
    """Smallest distance [m] from points (P, 2) to a rectangle; 0 inside."""
    local = np.abs(se2.transform(se2.inverse(pose), points)) - 0.5 * np.asarray(size)
    outside = np.maximum(local, 0.0)
    return float(np.hypot(outside[:, 0], outside[:, 1]).min())


def stones(
    lower: ArrayLike,
    upper: ArrayLike,
    count: int,
    radius: tuple[float, float],
    height: tuple[float, float],
    keep_clear: Array,
    clearance: float,
    rng: np.random.Generator,
) -> list[Prism]:
    """Up to ``count`` stones in a rectangle, sizes m drawn from ranges, ``clearance`` m off points (P, 2)."""
    lower, upper = np.asarray(lower, dtype=np.float64), np.asarray(upper, dtype=np.float64)
    route = cKDTree(keep_clear)
    drawn = []
    for _ in range(count):
        centre, size = rng.uniform(lower, upper), rng.uniform(*radius)
        if route.query(centre)[0] >= size + clearance:
            drawn.append(stone(centre, size, rng.uniform(*height), rng))
    return drawn
