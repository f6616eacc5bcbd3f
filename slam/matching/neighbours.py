"""Nearest neighbours in the plane: points sorted into the cells of a square lattice."""

from __future__ import annotations

import numpy as np
from numba import njit

MOST_CELLS = 200_000
"""The lattice is coarsened until it has no more cells than this."""


@njit(cache=True)
def build(points, cell):
    """Index of ``points (n, 2)`` m on a lattice of ``cell`` m: origin, cell, shape, first row per cell,
    rows."""
    low = np.array([points[:, 0].min(), points[:, 1].min()])
    extent_x, extent_y = points[:, 0].max() - low[0], points[:, 1].max() - low[1]
    while (extent_x / cell + 1.0) * (extent_y / cell + 1.0) > MOST_CELLS:
        cell *= 1.5
    columns, rows = int(extent_x / cell) + 1, int(extent_y / cell) + 1
    first = np.zeros(columns * rows + 1, np.int64)
    where = np.empty(len(points), np.int64)
    for i in range(len(points)):
        where[i] = int((points[i, 1] - low[1]) / cell) * columns + int((points[i, 0] - low[0]) / cell)
        first[where[i] + 1] += 1
    for k in range(columns * rows):
        first[k + 1] += first[k]
    filled = first[:-1].copy()
    order = np.empty(len(points), np.int64)
    for i in range(len(points)):
        order[filled[where[i]]] = i
        filled[where[i]] += 1
    return low, cell, columns, rows, first, order


@njit(cache=True)
def nearest(points, index, x, y, radius):
    """Row of the point nearest to ``(x, y)`` closer than ``radius`` m, or -1."""
    low, cell, columns, rows, first, order = index
    best, best_square = -1, radius * radius
    column, row = int(np.floor((x - low[0]) / cell)), int(np.floor((y - low[1]) / cell))
    for ring in range(int(radius / cell) + 2):
        if best >= 0 and best_square <= ((ring - 1) * cell) ** 2:
            break
        for r in range(max(row - ring, 0), min(row + ring, rows - 1) + 1):
            edge = r == row - ring or r == row + ring
            step = 1 if edge or ring == 0 else 2 * ring
            for c in range(column - ring, column + ring + 1, step):
                if c < 0 or c >= columns:
                    continue
                for k in range(first[r * columns + c], first[r * columns + c + 1]):
                    i = order[k]
                    square = (points[i, 0] - x) ** 2 + (points[i, 1] - y) ** 2
                    if square < best_square:
                        best, best_square = i, square
    return best
