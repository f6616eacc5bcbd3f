"""Loops over the wall points of one map that look up what another map has where they lie."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from slam.se2 import Array

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
