"""Overlap likelihood: do two maps show the same place? By what their wall points meet in each other."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numba import njit

from slam import se2
from slam.se2 import Array
from stitch.alignment.raster import Walls

DISTANCES = np.array([0.02, 0.04, 0.07, 0.12, 0.2, 0.35])
"""Limits [m] of the classes of a wall point's distance from the other map's nearest wall."""

WEIGHTS = np.array(
    [
        [0.25, 0.27, 0.07, 0.24, -0.15, 0.03, -0.54],
        [-0.14, -0.09, 0.19, 0.21, 0.06, -0.33, -0.43],
        [0.06, 0.11, -0.06, -0.03, 0.24, 0.22, 0.03],
        [0.09, 0.14, 0.16, -0.00, -0.12, -0.18, -0.04],
        [0.34, 0.05, -0.12, -0.19, 0.02, 0.72, -0.40],
        [0.23, 0.44, 0.41, 0.36, -0.22, 0.38, -0.07],
    ]
).reshape(2, 3, 7)
"""Weights of the square roots of `OverlapCounts.counts`."""
GAPS = np.array([-0.47, 0.04, -2.21])
"""Weights of the square roots of `OverlapCounts.gaps`."""
BIAS, PRIOR_BONUS = -9.69, 6.19
"""Log-odds of maps that never meet, and what a prior of 1 m and 10° adds where it expects them.

All are learnt: ``python -m scenarios.ablate likeness`` prints them."""


FACING = 0.3
"""Two surfaces face the same way when the cosine between their normals is above this, opposite ways when it
is below its negative. This and the next four are part of what the weights were learnt for: not settings."""
MISSED = 0.15
"""A point in free space that is farther [m] than this from a wall counts as off the wall."""
MIN_NORMAL = 0.5
"""Mean normals shorter than this are treated as undefined."""
MAX_GAP = 1.5
"""Widest gap in a wall [m] that counts: a doorway's."""
GAP_CLEARANCE, GAP_OFFSET, GAP_COSINE = 0.2, 0.12, 0.9
"""A point is in a wall gap if it is this far [m] from every wall, and walls go on beyond it within so much
[m] of its line and with at least this |cosine| to its normal."""


@dataclass(frozen=True)
class FreeSpaceMap:
    """A map in which the wall points of another are looked up.

    ``kinds (n,)`` of its own wall points: 0 on a long straight wall, 1 for what may be furniture; ``nearest
    (H, W)``: row of the wall point nearest to a cell of the map's grid, -1 beyond the last of `DISTANCES`.
    """

    walls: Walls
    kinds: np.ndarray
    nearest: np.ndarray

    @classmethod
    def of(cls, walls: Walls) -> FreeSpaceMap:
        """That of a submap's walls and free space."""
        grid = walls.grid
        shape, reach = grid.free.shape, float(DISTANCES[-1])
        nearest = nearest_points(walls.points, grid.origin, shape, grid.resolution, reach)
        return cls(walls, (walls.weights < 1.0).astype(np.int64), nearest)


@dataclass(frozen=True)
class OverlapCounts:
    """How many wall points, of both maps together, meet what in the other map.

    ``counts (2, 3, 7)``: by kind of the point (see `FreeSpaceMap`); by how the surfaces face: the same way,
    opposite ways, unknown; by distance (`DISTANCES`). The last column counts, in place of facing: points
    beside a wall in its free space (counted at their distance as well), in free space far from any wall, and
    where nothing is known.

    ``gaps (3,)``: points in free space apart from any wall, by whether the other's walls go on in line with
    their own on neither side, on one, on both. The last close a doorway of the other map, which moved
    furniture does not.
    """

    counts: np.ndarray
    gaps: np.ndarray


def count_overlap(a: FreeSpaceMap, b: FreeSpaceMap, T_a_b: Array) -> OverlapCounts:
    """What the wall points of both maps meet when b lies at ``T_a_b (3,)``."""
    counts, gaps = np.zeros((2, 3, len(DISTANCES) + 1), dtype=np.int64), np.zeros(3, dtype=np.int64)
    near, off = counts[:, :, :-1], counts[:, :, -1]
    for still, moving, T in ((a, b, np.asarray(T_a_b, dtype=np.float64)), (b, a, se2.inverse(T_a_b))):
        grid, walls, moved = still.walls.grid, still.walls, moving.walls
        onto = WallLookup(still.nearest, grid.free, grid.origin, grid.resolution, walls.points, walls.facing)
        classify_points(moved.points, moved.facing, moving.kinds, T, onto, DISTANCES, near, off)
        count_gap_points(moved.points, moved.facing, T, onto, gaps)
    return OverlapCounts(counts, gaps)


def overlap_log_odds(overlap: OverlapCounts) -> float:
    """Log-odds that two maps with this overlap show the same place there.

    Square roots, as neighbouring points along one wall are not independent.
    """
    return float(np.sum(WEIGHTS * np.sqrt(overlap.counts)) + GAPS @ np.sqrt(overlap.gaps) + BIAS)


class WallLookup(NamedTuple):
    """A map as its cells ``(H, W)``, cell (0, 0) starting at ``origin (2,)`` m, and its walls.

    ``nearest (H, W)``: row of the wall point nearest to the cell's middle, or -1; ``free (H, W)``; the wall
    ``points (m, 2)`` m and the mean normals ``facing (m, 2)`` of their surfaces.
    """

    nearest: np.ndarray
    free: np.ndarray
    origin: Array
    resolution: float
    points: Array
    facing: Array


@njit(cache=True)
def nearest_points(points: Array, origin: Array, shape: tuple[int, int], resolution: float, reach: float
                   ) -> np.ndarray:  # fmt: skip
    """Row of the point ``(n, 2)`` nearest to the middle of each cell of ``shape``, -1 beyond ``reach`` m.

    Cell (0, 0) starts at ``origin (2,)`` m, cells are ``resolution`` m.
    """
    rows = np.full(shape, -1, dtype=np.int32)
    best = np.full(shape, reach * reach)
    cells = int(np.ceil(reach / resolution))
    for n in range(points.shape[0]):
        j = int(np.floor((points[n, 0] - origin[0]) / resolution))
        i = int(np.floor((points[n, 1] - origin[1]) / resolution))
        left, right = max(j - cells, 0), min(j + cells + 1, shape[1])
        for row in range(max(i - cells, 0), min(i + cells + 1, shape[0])):
            dy = origin[1] + (row + 0.5) * resolution - points[n, 1]
            if dy * dy >= reach * reach:
                continue
            for column in range(left, right):
                dx = origin[0] + (column + 0.5) * resolution - points[n, 0]
                if dx * dx + dy * dy < best[row, column]:
                    best[row, column], rows[row, column] = dx * dx + dy * dy, n
    return rows


@njit(cache=True, error_model="numpy")
def classify_points(points: Array, facing: Array, kind: np.ndarray, T: Array, onto: WallLookup,
                    limits: Array, near: np.ndarray, off: np.ndarray) -> None:  # fmt: skip
    """Adds points ``(n, 2)``, moved by ``T (3,)``, to the counts of what they meet in another map.

    ``near (2, 3, D)``: by ``kind (n,)``, by how the surfaces face (same way, opposite, unknown) and by the
    first of ``limits (D,)`` m that holds their distance (across the wall where its normal is known).
    ``off (2, 3)``: by kind; in the free space beside a wall, in free space far from any, in unknown cells.
    """
    c, s = np.cos(T[2]), np.sin(T[2])
    nearest, free, origin, resolution, others, others_facing = onto
    for n in range(points.shape[0]):
        x = c * points[n, 0] - s * points[n, 1] + T[0]
        y = s * points[n, 0] + c * points[n, 1] + T[1]
        j, i = int(np.floor((x - origin[0]) / resolution)), int(np.floor((y - origin[1]) / resolution))
        if not (0 <= i < nearest.shape[0] and 0 <= j < nearest.shape[1]):
            off[kind[n], 2] += 1
            continue
        k = nearest[i, j]
        if k < 0:
            off[kind[n], 1 if free[i, j] else 2] += 1
            continue
        nx, ny = others_facing[k, 0], others_facing[k, 1]
        size = np.sqrt(nx * nx + ny * ny)
        dx, dy = x - others[k, 0], y - others[k, 1]
        distance = abs(dx * nx + dy * ny) / size if size > MIN_NORMAL else np.sqrt(dx * dx + dy * dy)
        if free[i, j] and distance > MISSED:
            off[kind[n], 0] += 1
        cosine = nx * (c * facing[n, 0] - s * facing[n, 1]) + ny * (s * facing[n, 0] + c * facing[n, 1])
        way = 0 if cosine > FACING else (1 if cosine < -FACING else 2)
        beyond = 0  # counted without branches, which the processor could not predict
        for limit in limits:
            beyond += not distance <= limit
        if beyond < len(limits):
            near[kind[n], way, beyond] += 1


@njit(cache=True)
def count_gap_points(points: Array, facing: Array, T: Array, onto: WallLookup, counts: np.ndarray) -> None:
    """Adds points ``(n, 2)``, moved by ``T (3,)``, that lie in free space apart from another map's walls.

    ``counts (3,)``: by whether those walls go on, in line with the point's own, on neither side, on one, or
    on both, no farther apart than `MAX_GAP`.
    """
    c, s = np.cos(T[2]), np.sin(T[2])
    nearest, free, origin, resolution, others, _ = onto
    for n in range(points.shape[0]):
        x = c * points[n, 0] - s * points[n, 1] + T[0]
        y = s * points[n, 0] + c * points[n, 1] + T[1]
        j, i = int(np.floor((x - origin[0]) / resolution)), int(np.floor((y - origin[1]) / resolution))
        if not (0 <= i < nearest.shape[0] and 0 <= j < nearest.shape[1] and free[i, j]):
            continue
        k = nearest[i, j]
        if k >= 0 and np.hypot(others[k, 0] - x, others[k, 1] - y) < GAP_CLEARANCE:
            continue
        nx, ny = c * facing[n, 0] - s * facing[n, 1], s * facing[n, 0] + c * facing[n, 1]
        size = np.hypot(nx, ny)
        if size <= MIN_NORMAL:
            counts[0] += 1
            continue
        line = (x, y, nx / size, ny / size)
        left, right = _next_wall(line, 1.0, onto), _next_wall(line, -1.0, onto)
        sides = int(left <= MAX_GAP) + int(right <= MAX_GAP)
        counts[2 if left + right <= MAX_GAP else min(sides, 1)] += 1


@njit(cache=True)
def _next_wall(line, way, onto):
    """Distance [m] along a ``line`` (x, y and its normal), ``way`` 1 or -1, to the next wall in line with it;
    infinity beyond `MAX_GAP`."""
    x, y, nx, ny = line
    nearest, _, origin, resolution, others, others_facing = onto
    for step in range(1, int(2.0 * MAX_GAP / resolution) + 1):
        far = 0.5 * step * resolution
        px, py = x - way * far * ny, y + way * far * nx
        j, i = int(np.floor((px - origin[0]) / resolution)), int(np.floor((py - origin[1]) / resolution))
        if not (0 <= i < nearest.shape[0] and 0 <= j < nearest.shape[1]):
            break
        k = nearest[i, j]
        if k < 0:
            continue
        dx, dy = others[k, 0] - px, others[k, 1] - py
        fx, fy = others_facing[k, 0], others_facing[k, 1]
        in_line = abs(dx * nx + dy * ny) <= GAP_OFFSET and abs(dy * nx - dx * ny) <= resolution
        if in_line and abs(fx * nx + fy * ny) >= GAP_COSINE * max(np.hypot(fx, fy), MIN_NORMAL):
            return far
    return np.inf
