"""Loops over the cells of rasters and of their Fourier transforms."""

from __future__ import annotations

import numpy as np
from numba import njit

from slam.se2 import Array


@njit(cache=True, error_model="numpy")
def cells_of(points: Array, T: Array, first: Array, shape: tuple[int, int], resolution: float) -> np.ndarray:
    """Cells ``(n,)`` of a lattice ``shape`` at ``first``, counted row by row, that points ``(n, 2)`` moved by
    ``T (3,)`` lie in; the nearest one for those beside it."""
    c, s = np.cos(T[2]), np.sin(T[2])
    out = np.empty(points.shape[0], dtype=np.int64)
    for n in range(points.shape[0]):
        x, y = points[n, 0], points[n, 1]
        column = np.floor((c * x - s * y + T[0]) / resolution) - first[0]
        row = np.floor((s * x + c * y + T[1]) / resolution) - first[1]
        column, row = min(max(column, 0.0), shape[1] - 1.0), min(max(row, 0.0), shape[0] - 1.0)
        out[n] = np.int64(row) * shape[1] + np.int64(column)
    return out


@njit(cache=True, error_model="numpy")
def look_up(cells: np.ndarray, origin: Array, side: float, T: Array, first: Array, shape: tuple[int, int],
            resolution: float) -> np.ndarray:  # fmt: skip
    """Which cells of a lattice ``shape`` at ``first`` have their centre on a true cell of a map moved by T.

    The map's ``cells (H, W)`` of ``side`` m start at ``origin``; the lattice has cells of ``resolution`` m.
    """
    c, s = np.cos(T[2]), np.sin(T[2])
    height, width = cells.shape
    x = (first[0] + np.arange(shape[1]) + 0.5) * resolution - T[0]
    along, across = c * x, s * x
    rows, columns = np.empty(shape[1], dtype=np.int32), np.empty(shape[1], dtype=np.int32)
    out = np.zeros(shape, dtype=np.bool_)
    for row in range(shape[0]):
        y = (first[1] + row + 0.5) * resolution - T[1]
        for column in range(shape[1]):  # apart from the reading, so that it is vectorised
            rows[column] = np.int32(np.floor((c * y - across[column] - origin[1]) / side))
            columns[column] = np.int32(np.floor((along[column] + s * y - origin[0]) / side))
        for column in range(shape[1]):
            i, j = rows[column], columns[column]
            if 0 <= i < height and 0 <= j < width:
                out[row, column] = cells[i, j]
    return out


@njit(cache=True)
def multiply_spectra(a: np.ndarray, b: np.ndarray, gain: np.ndarray, alike: float, turned: bool = False
                     ) -> np.ndarray:  # fmt: skip
    """Transforms ``(2, H, W)`` of agreement and conflict from those of two maps ``(4, H, W)``: walls, free
    space, and the two components of the walls' normals.

    ``gain (H, W)`` is the blur's; ``alike`` the share of the agreement that depends on facing the same way.
    ``turned``: b is turned by half a turn, which conjugates its transforms and negates its normals.
    """
    out = np.empty(a[:2].shape, dtype=np.complex64)
    agreement, conflict = out[0].ravel(), out[1].ravel()
    walls_a, free_a, x_a, y_a = a[0].ravel(), a[1].ravel(), a[2].ravel(), a[3].ravel()
    walls_b, free_b, x_b, y_b = b[0].ravel(), b[1].ravel(), b[2].ravel(), b[3].ravel()
    flat, one, other = gain.ravel(), np.float32(1.0 - alike), np.float32(alike)
    for i in range(flat.size):
        k = np.uint64(i)
        if turned:
            walls, free, x, y = walls_b[k], free_b[k], -x_b[k], -y_b[k]
        else:
            walls, free, x, y = np.conj(walls_b[k]), np.conj(free_b[k]), np.conj(x_b[k]), np.conj(y_b[k])
        facing = x_a[k] * x + y_a[k] * y
        agreement[k] = flat[k] * (one * walls_a[k] * walls + other * facing)
        conflict[k] = free_a[k] * walls + walls_a[k] * free
    return out
