"""Loops over points and cells that find the walls of a submap or a grid."""

from __future__ import annotations

import numpy as np
from numba import njit

from slam.se2 import Array

BESIDE = 0.38
"""Sine of the angle between a wall and the way to a neighbouring cell, from which the cell is beside it."""


@njit(cache=True, error_model="numpy")
def thin_points(points: Array, normals: Array, occupied: np.ndarray, origin: Array, side: float,
                resolution: float) -> tuple[Array, Array]:  # fmt: skip
    """Mean ``(m, 2)`` of the points ``(n, 2)`` on occupied cells in each cell of ``resolution`` m, row by
    row, and the mean ``(m, 2)`` of their normals, NaN counting as zero.

    ``occupied (H, W)`` has cells of ``side`` m and starts at ``origin (2,)``.
    """
    height, width = occupied.shape
    # the thinned cells that the grid touches, and one more on either side for what rounding may do
    left, low = np.floor(origin[0] / resolution) - 1.0, np.floor(origin[1] / resolution) - 1.0
    columns = int(np.floor((origin[0] + width * side) / resolution) - left) + 2
    rows = int(np.floor((origin[1] + height * side) / resolution) - low) + 2
    slots = np.full(rows * columns, -1, dtype=np.int32)
    sums, used = np.empty((min(points.shape[0], rows * columns), 5)), 0
    for n in range(points.shape[0]):
        x, y = points[n, 0], points[n, 1]
        j, i = int(np.floor((x - origin[0]) / side)), int(np.floor((y - origin[1]) / side))
        if not (0 <= i < height and 0 <= j < width and occupied[i, j]):
            continue
        cell = int(np.floor(y / resolution) - low) * columns + int(np.floor(x / resolution) - left)
        slot = slots[cell]
        if slot < 0:
            slot = slots[cell] = used
            sums[slot, :] = 0.0
            used += 1
        sums[slot, 0] += x
        sums[slot, 1] += y
        sums[slot, 2] += 1.0
        if np.isfinite(normals[n, 0]):
            sums[slot, 3] += normals[n, 0]
            sums[slot, 4] += normals[n, 1]
    means, facing, k = np.empty((used, 2)), np.empty((used, 2)), 0
    for slot in slots:
        if slot >= 0:
            count = sums[slot, 2]
            means[k, 0], means[k, 1] = sums[slot, 0] / count, sums[slot, 1] / count
            facing[k, 0], facing[k, 1] = sums[slot, 3] / count, sums[slot, 4] / count
            k += 1
    return means, facing


@njit(cache=True)
def straight_run_lengths(occupied: np.ndarray, reach: int, directions: int) -> np.ndarray:
    """Length ``(H, W)`` in cells of the longest straight run through each occupied cell, at most 2 reach + 1;
    the search ends with the first run longer than ``reach``.

    A run goes in one of ``directions``, over cells that are occupied or next to one, and ends at the first
    that is not.
    """
    height, width = occupied.shape
    border = reach + 1  # that no run gets through
    near = np.zeros((height + 2 * border, width + 2 * border), dtype=np.bool_)
    for i in range(height):
        for j in range(width):
            if occupied[i, j]:
                near[border + i - 1 : border + i + 2, border + j] = True
                near[border + i, border + j - 1 : border + j + 2] = True
    near[reach], near[border + height], near[:, reach], near[:, border + width] = False, False, False, False
    across, near_cells = near.shape[1], near.ravel()
    steps = np.empty((directions, 2, reach), dtype=np.int64)
    for k in range(directions):
        c, s = np.cos(np.pi * k / directions), np.sin(np.pi * k / directions)
        for step in range(reach):
            steps[k, 0, step] = int(np.round((step + 1) * s)) * across + int(np.round((step + 1) * c))
            steps[k, 1, step] = -steps[k, 0, step]
    runs = np.zeros((height, width), dtype=np.int32)
    for i in range(height):
        for j in range(width):
            if not occupied[i, j]:
                continue
            at, longest = (border + i) * across + border + j, 0
            for k in range(directions):
                run = 1
                for way in range(2):
                    for step in range(reach):
                        if not near_cells[np.uint64(at + steps[k, way, step])]:
                            break
                        run += 1
                longest = max(longest, run)
                if longest > reach:
                    break
            runs[i, j] = longest
    return runs


@njit(cache=True)
def lines_through(surface: np.ndarray, open_cells: np.ndarray, cells: np.ndarray, reach: float):
    """Principal axis of the surface cells within ``reach`` cells of each of ``cells (n, 2)``.

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
