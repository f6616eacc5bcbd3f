"""Everything a robot can meet: solids, ground and ceiling, debris that it pushes, people who walk."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from sim.floorplan import BELOW_FLOOR, Prism, round_prism
from sim.smoke import Smoke
from sim.terrain import Terrain
from slam.se2 import Array


class Obstacles(NamedTuple):
    """Solids as arrays, for the kernels.

    Obstacle k owns the edges ``first[k]:first[k+1]``; one edge alone is a thin upright plate, three or more
    are a convex footprint. ``edges (E, 4)`` m; ``planes (E, 3)``: outward unit normal and offset, n·p <= c
    inside; ``z_lo, z_hi (K,)`` m.
    """

    first: np.ndarray
    edges: Array
    planes: Array
    z_lo: Array
    z_hi: Array

    def without_heights(self) -> Obstacles:
        """The same footprints, endlessly high."""
        return self._replace(z_lo=np.full_like(self.z_lo, -np.inf), z_hi=np.full_like(self.z_hi, np.inf))


def plates(segments: ArrayLike, heights: ArrayLike | None = None) -> Obstacles:
    """Thin plates over ``segments (S, 4)`` m.

    ``heights`` are (z_lo, z_hi) of each ``(S, 2)``, or the tops ``(S,)`` of plates that reach endlessly down;
    without them the plates are endless both ways. Raises ``ValueError`` for other shapes, values that are not
    finite, or a segment without length.
    """
    segments = np.ascontiguousarray(segments, dtype=np.float64)
    if segments.ndim != 2 or segments.shape[1] != 4:
        raise ValueError(f"segments: expected shape (S, 4), got {segments.shape}")
    along = segments[:, 2:] - segments[:, :2]
    if not np.all(np.hypot(along[:, 0], along[:, 1]) > 0.0):
        raise ValueError("segments: expected finite end points and lengths > 0")
    z_lo, z_hi = np.full(len(segments), -np.inf), np.full(len(segments), np.inf)
    if heights is not None:
        heights = np.asarray(heights, dtype=np.float64)
        if heights.shape not in ((count := len(segments),), (count, 2)):
            raise ValueError(f"heights: expected ({count},) or ({count}, 2), got {heights.shape}")
        z_hi = heights if heights.ndim == 1 else heights[:, 1]
        z_lo = z_lo if heights.ndim == 1 else heights[:, 0]
    first = np.arange(len(segments) + 1)
    return Obstacles(first, segments, _planes(segments), z_lo.copy(), z_hi.copy())


def solids(prisms: Sequence[Prism]) -> Obstacles:
    """Prisms as arrays."""
    edges = np.vstack([prism.edges for prism in prisms]) if prisms else np.empty((0, 4))
    first = np.cumsum([0, *(len(prism.footprint) for prism in prisms)])
    z_lo = np.array([prism.z_lo for prism in prisms], dtype=np.float64)
    z_hi = np.array([prism.z_hi for prism in prisms], dtype=np.float64)
    return Obstacles(first, edges, _planes(edges), z_lo, z_hi)


def _planes(edges: Array) -> Array:
    along = edges[:, 2:] - edges[:, :2]
    normal = np.stack([along[:, 1], -along[:, 0]], -1) / np.hypot(along[:, 0], along[:, 1])[:, None]
    return np.ascontiguousarray(np.column_stack([normal, np.sum(normal * edges[:, :2], axis=1)]))


@dataclass(frozen=True)
class Debris:
    """A loose solid of ``mass`` kg where ``prism`` is at first, its heights above the ground under it.

    ``friction`` is Coulomb's coefficient between it and the ground. Raises ``ValueError`` unless mass > 0
    and friction >= 0.
    """

    prism: Prism
    mass: float
    friction: float = 0.5

    def __post_init__(self) -> None:
        if not (self.mass > 0.0 and self.friction >= 0.0):
            given = f"got {self.mass} and {self.friction}"
            raise ValueError(f"debris: expected mass > 0 and friction >= 0, {given}")

    @property
    def centre(self) -> Array:
        """Centre of mass (2) m at first; the body frame is there, parallel to the world's."""
        x, y = self.prism.footprint.T
        cross = x * np.roll(y, -1) - np.roll(x, -1) * y
        sums = self.prism.footprint + np.roll(self.prism.footprint, -1, axis=0)
        return cross @ sums / (3.0 * cross.sum())

    @property
    def shape(self) -> Prism:
        """The solid in its body frame."""
        return Prism(self.prism.footprint - self.centre, self.prism.z_lo, self.prism.z_hi, self.prism.kind)


@dataclass(frozen=True)
class Person:
    """Somebody who walks round the closed ``loop (K, 2)`` m at ``speed`` m/s for ever.

    ``start``: share of the loop already walked at time 0. Turns round rather than come nearer than
    ``keep_off`` m to the robot. Raises ``ValueError`` for a loop without length or fewer than two points.
    """

    loop: Array
    speed: float = 1.0
    start: float = 0.0
    radius: float = 0.2
    height: float = 1.75
    keep_off: float = 0.8

    def __post_init__(self) -> None:
        loop = np.ascontiguousarray(self.loop, dtype=np.float64)
        if loop.ndim != 2 or loop.shape[0] < 2 or loop.shape[1] != 2:
            raise ValueError(f"person: expected a loop (K >= 2, 2), got {loop.shape}")
        if not np.all(np.hypot(*(np.roll(loop, -1, axis=0) - loop).T) > 0.0):
            raise ValueError("person: expected legs of the loop with length > 0")
        if not (self.speed >= 0.0 and self.radius > 0.0):
            given = f"got {self.speed} and {self.radius}"
            raise ValueError(f"person: expected speed >= 0 and radius > 0, {given}")
        object.__setattr__(self, "loop", loop)

    @property
    def shape(self) -> Prism:
        """The person as an upright solid in the body frame."""
        return round_prism([0.0, 0.0], self.radius, 8, BELOW_FLOOR, self.height, "furniture")


@dataclass(frozen=True)
class World:
    """Solids on a terrain under a level ``ceiling`` [m] (infinite: open sky); smoke, debris and people."""

    prisms: tuple[Prism, ...]
    terrain: Terrain
    ceiling: float = np.inf
    smoke: Smoke | None = None
    debris: tuple[Debris, ...] = ()
    people: tuple[Person, ...] = ()

    @property
    def obstacles(self) -> Obstacles:
        """All solids that stay where they are, as arrays."""
        return solids(self.prisms)

    @property
    def movers(self) -> Obstacles:
        """Debris, then people, as arrays: each solid in its body frame."""
        return solids([*(d.shape for d in self.debris), *(p.shape for p in self.people)])

    def outlines(self, z: float) -> Array:
        """Edges ``(S, 4)`` m of what a plane at height ``z`` cuts: the true map of a level laser."""
        cut = [prism.edges for prism in self.prisms if prism.z_lo <= z <= prism.z_hi]
        return np.vstack(cut) if cut else np.empty((0, 4))
