"""Everything a robot can meet: solids, the ground and the ceiling."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from sim.floorplan import Prism, outlines
from sim.movers import Debris, Person
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
        if heights.shape not in ((len(segments),), (len(segments), 2)):
            raise ValueError(
                f"heights: expected ({len(segments)},) or ({len(segments)}, 2), got {heights.shape}"
            )
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

    def without_heights(self) -> World:
        """The same world with its still solids endlessly high."""
        endless = (replace(prism, z_lo=-np.inf, z_hi=np.inf) for prism in self.prisms)
        return replace(self, prisms=tuple(endless))

    def outlines(self, z: float) -> Array:
        """Edges ``(S, 4)`` m of what a plane at height ``z`` cuts: the true map of a level laser."""
        return outlines(self.prisms, z)
