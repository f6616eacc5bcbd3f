"""Walls of a map that may be bent: thinned points that know which way they face, and the nearest of them from
anywhere."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import distance_transform_edt

from slam.mapping.submap import Submap
from slam.se2 import Array

CELL = 0.2
"""Side [m] of the cells that points are thinned to, and of the lattice of the nearest ones."""
REACH = 3.0
"""Metres around a map's walls within which the nearest of them is known."""
UNKNOWN = 4
"""Class of the points whose facing is unknown; 0 to 3 are quarters of the circle about the map's main
direction."""


@dataclass(frozen=True)
class FacingWalls:
    """Wall points ``(n, 2)`` m in the map's frame, the way they face ``angles (n,)`` rad (0 where unknown),
    ``known (n,)``, and their ``weights (n,)`` in metres of wall.

    On a lattice of `CELL` m whose cell (0, 0) has its lower left corner at ``corner (2,)`` m:
    ``nearest (5, H, W)`` int32, the index of the nearest point by class of facing, -1 where the class is
    empty or farther than `REACH`; ``distance (H, W)`` m to the nearest point of any class;
    ``free (H, W)``. ``main`` rad is the direction that class 0 faces.
    """

    points: Array
    angles: Array
    known: np.ndarray
    weights: Array
    main: float
    corner: Array
    nearest: np.ndarray
    distance: np.ndarray
    free: np.ndarray

    @property
    def middle(self) -> Array:
        """The middle ``(2,)`` m of the box round the walls."""
        return 0.5 * (self.points.min(axis=0) + self.points.max(axis=0))


def facing_walls(submap: Submap, unknown_weight: float) -> FacingWalls:
    """The walls of a submap, one point for each cell and class of facing; a metre of wall that faces nowhere
    weighs ``unknown_weight``."""
    scan = submap.points
    known = np.isfinite(scan.normals[:, 0])
    angles = np.where(known, np.arctan2(scan.normals[:, 1], scan.normals[:, 0]), 0.0)
    main = float(np.angle(np.sum(np.exp(4j * angles[known])) + 1e-12)) / 4.0
    points, angles, known = _thinned(scan.points, angles, known, main)
    weights = CELL * np.where(known, 1.0, unknown_weight)
    corner = np.floor((points.min(axis=0) - REACH) / CELL) * CELL
    columns, rows = np.ceil((points.max(axis=0) + REACH - corner) / CELL).astype(int)
    nearest, distance = _nearest(points, classes_of(angles, known, main), corner, (int(rows), int(columns)))
    return FacingWalls(
        points, angles, known, weights, main, corner, nearest, distance, _free(submap, corner, distance.shape)
    )


def classes_of(angles: Array, known: np.ndarray, main: float) -> np.ndarray:
    """Class of facing ``(n,)`` of ``angles (n,)`` rad."""
    quarter = np.floor((angles - main) / (0.5 * np.pi) + 0.5).astype(np.int64) % UNKNOWN
    return np.where(known, quarter, UNKNOWN)


def _thinned(points: Array, angles: Array, known: np.ndarray, main: float) -> tuple[Array, Array, np.ndarray]:
    """The mean point and facing for each cell and class."""
    cells = np.floor(points / CELL).astype(np.int64)
    cells -= cells.min(axis=0)
    key = (cells[:, 1] * (cells[:, 0].max() + 1) + cells[:, 0]) * (UNKNOWN + 1)
    key += classes_of(angles, known, main)
    _, first, group = np.unique(key, return_index=True, return_inverse=True)
    count = np.bincount(group)
    mean = np.stack([np.bincount(group, points[:, axis]) / count for axis in (0, 1)], -1)
    facing = np.bincount(group, np.cos(angles)) + 1j * np.bincount(group, np.sin(angles))
    return mean, np.where(known[first], np.angle(facing), 0.0), known[first]


def _nearest(
    points: Array, classes: np.ndarray, corner: Array, shape: tuple[int, int]
) -> tuple[np.ndarray, np.ndarray]:
    """Index of the nearest point by class ``(5, H, W)`` and the distance ``(H, W)`` m to any."""
    column, row = np.floor((points - corner) / CELL).astype(np.int64).T
    nearest = np.full((UNKNOWN + 1, *shape), -1, dtype=np.int32)
    least = np.full(shape, np.inf, dtype=np.float32)
    for k in range(UNKNOWN + 1):
        own = np.flatnonzero(classes == k)
        if len(own) == 0:
            continue
        index = np.full(shape, -1, dtype=np.int32)
        index[row[own], column[own]] = own
        distance, (rows, columns) = distance_transform_edt(index < 0, return_indices=True)
        distance *= CELL
        nearest[k] = np.where(distance <= REACH, index[rows, columns], -1)
        np.minimum(least, distance, out=least, casting="same_kind")
    return nearest, least


def _free(submap: Submap, corner: Array, shape: tuple[int, ...]) -> np.ndarray:
    """Whether the middle of each cell of the lattice is free."""
    grid = submap.grid
    height, width = grid.free.shape
    inside, looked_up = [], []
    for axis, count, size in ((1, shape[0], height), (0, shape[1], width)):
        centres = corner[axis] + (np.arange(count) + 0.5) * CELL
        index = np.floor((centres - grid.origin[axis]) / grid.resolution).astype(np.int64)
        inside.append((index >= 0) & (index < size))
        looked_up.append(index.clip(0, size - 1))
    free: np.ndarray = grid.free[np.ix_(*looked_up)] & np.logical_and.outer(*inside)
    return free
