"""Furniture placed against walls, and stones strewn about, clear of the route."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial import cKDTree

from sim.driver import resample
from sim.floorplan import Prism, bed, box, cupboard, desk, stone, table
from slam import se2
from slam.se2 import Array

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
