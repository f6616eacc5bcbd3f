"""Reading walls off a grid: the loops over cells."""

from __future__ import annotations

import numpy as np
from numba import njit

BESIDE = 0.38
"""A neighbour lies beside a wall when its direction is more than this sine off the wall's own."""


@njit(cache=True)
def lines_through(surface: np.ndarray, open_cells: np.ndarray, cells: np.ndarray, reach: float):
    """The straight line through the surface cells within ``reach`` cells of each of ``cells (n, 2)``.

    Returns, in cells: the mean (column, row) of the neighbours relative to the cell ``(n, 2)``, the line's
    direction ``(n,)`` rad, the scatter along and across it ``(n, 2)`` (variances), the neighbours ``(n,)``,
    and the open cells touching the cell left and right of that direction ``(n, 2)``.
    """
    n, r = len(cells), int(reach)
    mean, scatter = np.zeros((n, 2)), np.zeros((n, 2))
    direction, count, sides = np.zeros(n), np.zeros(n, np.int64), np.zeros((n, 2), np.int64)
    for p in range(n):
        row, column = cells[p]
        sx = sy = sxx = sxy = syy = 0.0
        for i in range(max(row - r, 0), min(row + r + 1, surface.shape[0])):
            for j in range(max(column - r, 0), min(column + r + 1, surface.shape[1])):
                x, y = j - column, i - row
                if surface[i, j] and x * x + y * y <= reach * reach:
                    count[p] += 1
                    sx, sy = sx + x, sy + y
                    sxx, sxy, syy = sxx + x * x, sxy + x * y, syy + y * y
        k = float(count[p])
        sx, sy = sx / k, sy / k
        xx, xy, yy = sxx / k - sx * sx, sxy / k - sx * sy, syy / k - sy * sy
        mean[p, 0], mean[p, 1] = sx, sy
        direction[p] = 0.5 * np.arctan2(2.0 * xy, xx - yy)
        spread = np.sqrt(0.25 * (xx - yy) ** 2 + xy * xy)
        scatter[p, 0], scatter[p, 1] = 0.5 * (xx + yy) + spread, max(0.5 * (xx + yy) - spread, 0.0)
        c, s = np.cos(direction[p]), np.sin(direction[p])
        for i in range(max(row - 1, 0), min(row + 2, surface.shape[0])):
            for j in range(max(column - 1, 0), min(column + 2, surface.shape[1])):
                if open_cells[i, j]:
                    across = (c * (i - row) - s * (j - column)) / np.hypot(i - row, j - column)
                    sides[p, 0] += across > BESIDE
                    sides[p, 1] += across < -BESIDE
    return mean, direction, scatter, count, sides
