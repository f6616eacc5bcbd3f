"""The kernel behind `slam.mapping.occupancy.draw`: only drawing pays for importing numba."""

from __future__ import annotations

import numpy as np
from numba import njit

from slam.se2 import Array


@njit(cache=True)
def count(starts: Array, ends: Array, first: Array, shape: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
    """Hits and passes ``(H, W)`` of rays, by walking the cells of each ray (Amanatides & Woo 1987).

    ``starts (N, 2)`` and ``ends (N, B, 2)`` are in cells, NaN where a beam came back from nowhere; ``first
    (2,)`` is the lattice index of cell (0, 0). The end cell counts one hit, every cell before it one pass.
    """
    hits = np.zeros(shape, dtype=np.int32)
    passes = np.zeros(shape, dtype=np.int32)
    for i in range(ends.shape[0]):
        x0 = starts[i, 0] - first[0]
        y0 = starts[i, 1] - first[1]
        for j in range(ends.shape[1]):
            if not np.isnan(ends[i, j, 0]):
                _walk(x0, y0, ends[i, j, 0] - first[0], ends[i, j, 1] - first[1], hits, passes)
    return hits, passes


@njit(cache=True, inline="always")
def _walk(x0, y0, x1, y1, hits, passes):
    column, row = int(np.floor(x0)), int(np.floor(y0))
    last_column, last_row = int(np.floor(x1)), int(np.floor(y1))
    dx, dy = x1 - x0, y1 - y0
    step_x, step_y = (1 if dx > 0.0 else -1), (1 if dy > 0.0 else -1)
    t_x = t_y = per_x = per_y = np.inf
    if dx != 0.0:
        per_x = abs(1.0 / dx)
        t_x = ((column + 1 - x0) if dx > 0.0 else (x0 - column)) * per_x
    if dy != 0.0:
        per_y = abs(1.0 / dy)
        t_y = ((row + 1 - y0) if dy > 0.0 else (y0 - row)) * per_y
    for _ in range(abs(last_column - column) + abs(last_row - row)):
        passes[row, column] += 1
        # the second conditions keep rounding from walking past the end cell
        if row == last_row or (column != last_column and t_x < t_y):
            column += step_x
            t_x += per_x
        else:
            row += step_y
            t_y += per_y
    hits[row, column] += 1
