"""What the walls of one map meet in another: the loops over points."""

from __future__ import annotations

import numpy as np
from numba import njit

from slam.se2 import Array

FACING = 0.3
"""Cosine from which two surfaces face the same way, and below whose negative opposite ways."""
BESIDE = 0.15
"""A point in free space so far [m] from a wall has missed it."""
KNOWN = 0.5
"""Length of a mean normal from which it is one."""
WIDEST = 1.5
"""Of a gap in a wall [m]: a doorway's."""
APART, IN_LINE, PARALLEL = 0.2, 0.12, 0.9
"""What stands in a gap is so far from any wall [m]; walls go on beyond it within so much of the line [m], and
face, either way, by a cosine of so much as it does."""


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
def meet(points: Array, facing: Array, kind: np.ndarray, T: Array, nearest: np.ndarray, free: np.ndarray,
         origin: Array, resolution: float, others: Array, others_facing: Array, limits: Array,
         met: np.ndarray, missed: np.ndarray) -> None:  # fmt: skip
    """Counts what points ``(n, 2)``, moved by ``T (3,)``, meet in a map whose walls are ``others (m, 2)``.

    ``met (2, 3, D)``: by ``kind (n,)``, by how the surfaces face (same way, opposite, unknown) and by the
    first of ``limits (D,)`` m that their distance (across the wall where that is known) is within.
    ``missed (2, 3)``: by kind, in the free space a little off a wall, far from any, and nothing known there.
    """
    c, s = np.cos(T[2]), np.sin(T[2])
    for n in range(points.shape[0]):
        x = c * points[n, 0] - s * points[n, 1] + T[0]
        y = s * points[n, 0] + c * points[n, 1] + T[1]
        j, i = int(np.floor((x - origin[0]) / resolution)), int(np.floor((y - origin[1]) / resolution))
        if not (0 <= i < nearest.shape[0] and 0 <= j < nearest.shape[1]):
            missed[kind[n], 2] += 1
            continue
        k = nearest[i, j]
        if k < 0:
            missed[kind[n], 1 if free[i, j] else 2] += 1
            continue
        nx, ny = others_facing[k, 0], others_facing[k, 1]
        size = np.sqrt(nx * nx + ny * ny)
        dx, dy = x - others[k, 0], y - others[k, 1]
        distance = abs(dx * nx + dy * ny) / size if size > KNOWN else np.sqrt(dx * dx + dy * dy)
        if free[i, j] and distance > BESIDE:
            missed[kind[n], 0] += 1
        alike = nx * (c * facing[n, 0] - s * facing[n, 1]) + ny * (s * facing[n, 0] + c * facing[n, 1])
        way = 0 if alike > FACING else (1 if alike < -FACING else 2)
        beyond = 0  # counted, not searched for: which one it is cannot be guessed ahead
        for limit in limits:
            beyond += not distance <= limit
        if beyond < len(limits):
            met[kind[n], way, beyond] += 1


@njit(cache=True)
def stand_in_gaps(points: Array, facing: Array, T: Array, nearest: np.ndarray, free: np.ndarray,
                  origin: Array, resolution: float, others: Array, others_facing: Array,
                  counts: np.ndarray) -> None:  # fmt: skip
    """Counts points ``(n, 2)``, moved by ``T (3,)``, in free space apart from the walls ``others (m, 2)``.

    ``counts (3,)``: by whether those walls go on, in line with the point's own, on neither side, on one, or
    on both, no farther apart than `WIDEST`.
    """
    c, s = np.cos(T[2]), np.sin(T[2])
    for n in range(points.shape[0]):
        x = c * points[n, 0] - s * points[n, 1] + T[0]
        y = s * points[n, 0] + c * points[n, 1] + T[1]
        j, i = int(np.floor((x - origin[0]) / resolution)), int(np.floor((y - origin[1]) / resolution))
        if not (0 <= i < nearest.shape[0] and 0 <= j < nearest.shape[1] and free[i, j]):
            continue
        k = nearest[i, j]
        if k >= 0 and np.hypot(others[k, 0] - x, others[k, 1] - y) < APART:
            continue
        nx, ny = c * facing[n, 0] - s * facing[n, 1], s * facing[n, 0] + c * facing[n, 1]
        size = np.hypot(nx, ny)
        if size <= KNOWN:
            counts[0] += 1
            continue
        line = (x, y, nx / size, ny / size)
        left = _goes_on(line, 1.0, nearest, origin, resolution, others, others_facing)
        right = _goes_on(line, -1.0, nearest, origin, resolution, others, others_facing)
        sides = int(left <= WIDEST) + int(right <= WIDEST)
        counts[2 if left + right <= WIDEST else min(sides, 1)] += 1


@njit(cache=True)
def _goes_on(line, way, nearest, origin, resolution, others, others_facing):
    """How far along a ``line`` (x, y, and its normal), one ``way`` or the other (1, -1), the next wall in
    line with it is; infinity beyond `WIDEST`."""
    x, y, nx, ny = line
    for step in range(1, int(2.0 * WIDEST / resolution) + 1):
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
        in_line = abs(dx * nx + dy * ny) <= IN_LINE and abs(dy * nx - dx * ny) <= resolution
        if in_line and abs(fx * nx + fy * ny) >= PARALLEL * max(np.hypot(fx, fy), KNOWN):
            return far
    return np.inf
