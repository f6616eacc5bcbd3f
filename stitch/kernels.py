"""The hot loops of stitching; apart from the rest so that only aligning pays for importing numba."""

from __future__ import annotations

import numpy as np
from numba import njit

from slam.se2 import Array


@njit(cache=True)
def vote(points: Array, n_theta: int, first: float, resolution: float, n_rho: int) -> Array:
    """Hough transform ``(n_theta, n_rho)`` of points ``(n, 2)``, each vote split between two bins.

    Bin i of ρ is centred on ``first + i·resolution``.
    """
    votes = np.zeros((n_theta, n_rho))
    start = first / resolution
    for k in range(n_theta):
        c, s = np.cos(np.pi * k / n_theta) / resolution, np.sin(np.pi * k / n_theta) / resolution
        for j in range(points.shape[0]):
            at = points[j, 0] * c + points[j, 1] * s - start
            i = int(at)  # never negative
            votes[k, i] += 1.0 - (at - i)
            votes[k, i + 1] += at - i
    return votes


@njit(cache=True)
def look_up(cells: np.ndarray, origin: Array, side: float, T: Array, first: Array, shape: tuple[int, int],
            resolution: float) -> np.ndarray:  # fmt: skip
    """Which cells of a lattice ``shape`` at ``first`` have their centre on a true cell, once moved by T.

    ``cells (H, W)`` of side ``side`` m start at ``origin``; the lattice has cells of ``resolution`` m.
    """
    c, s = np.cos(T[2]), np.sin(T[2])
    out = np.zeros(shape, dtype=np.bool_)
    for row in range(shape[0]):
        y = (first[1] + row + 0.5) * resolution - T[1]
        for column in range(shape[1]):
            x = (first[0] + column + 0.5) * resolution - T[0]
            i = int(np.floor((c * y - s * x - origin[1]) / side))
            j = int(np.floor((c * x + s * y - origin[0]) / side))
            if 0 <= i < cells.shape[0] and 0 <= j < cells.shape[1]:
                out[row, column] = cells[i, j]
    return out


@njit(cache=True)
def sum_along(field: np.ndarray, first: Array, resolution: float, points: Array, poses: Array) -> Array:
    """Sums ``(K,)`` of a field ``(H, W)``, bilinear, zero outside, at points ``(n, 2)`` moved by ``(K, 3)``.

    Cell (0, 0) of the field is the lattice cell ``first``, cells are ``resolution`` m.
    """
    height, width = field.shape
    out = np.zeros(poses.shape[0])
    for k in range(poses.shape[0]):
        c, s = np.cos(poses[k, 2]) / resolution, np.sin(poses[k, 2]) / resolution
        x0 = poses[k, 0] / resolution - first[0] - 0.5
        y0 = poses[k, 1] / resolution - first[1] - 0.5
        total = 0.0
        for n in range(points.shape[0]):
            x = c * points[n, 0] - s * points[n, 1] + x0
            y = s * points[n, 0] + c * points[n, 1] + y0
            if 0.0 <= x < width - 1 and 0.0 <= y < height - 1:
                j, i = int(x), int(y)
                u, v = x - j, y - i
                total += (1.0 - v) * ((1.0 - u) * field[i, j] + u * field[i, j + 1])
                total += v * ((1.0 - u) * field[i + 1, j] + u * field[i + 1, j + 1])
        out[k] = total
    return out
