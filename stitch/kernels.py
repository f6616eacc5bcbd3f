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
def thin(points: Array, normals: Array, occupied: np.ndarray, origin: Array, side: float,
         resolution: float) -> tuple[Array, Array]:  # fmt: skip
    """Points ``(n, 2)`` on occupied cells, thinned: the mean of those in each cell of ``resolution`` m, and
    the mean of their normals, NaN counting as nothing.

    ``occupied (H, W)`` has cells of ``side`` m and starts at ``origin``. Row by row, as the cells are.
    """
    height, width = occupied.shape
    kept = np.zeros(points.shape[0], dtype=np.bool_)
    low, high = np.full(2, np.inf), np.full(2, -np.inf)
    for n in range(points.shape[0]):
        j = int(np.floor((points[n, 0] - origin[0]) / side))
        i = int(np.floor((points[n, 1] - origin[1]) / side))
        kept[n] = 0 <= i < height and 0 <= j < width and occupied[i, j]
        if kept[n]:
            for k in range(2):
                low[k] = min(low[k], np.floor(points[n, k] / resolution))
                high[k] = max(high[k], np.floor(points[n, k] / resolution))
    if not low[0] <= high[0]:
        return np.zeros((0, 2)), np.zeros((0, 2))
    rows, columns = int(high[1] - low[1]) + 1, int(high[0] - low[0]) + 1
    sums = np.zeros((rows * columns, 5))
    for n in range(points.shape[0]):
        if kept[n]:
            j = int(np.floor(points[n, 0] / resolution) - low[0])
            i = int(np.floor(points[n, 1] / resolution) - low[1])
            sums[i * columns + j, 0] += points[n, 0]
            sums[i * columns + j, 1] += points[n, 1]
            sums[i * columns + j, 2] += 1.0
            if np.isfinite(normals[n, 0]):
                sums[i * columns + j, 3] += normals[n, 0]
                sums[i * columns + j, 4] += normals[n, 1]
    used = np.flatnonzero(sums[:, 2])
    return sums[used, :2] / sums[used, 2:3], sums[used, 3:] / sums[used, 2:3]


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
def sum_along(field: np.ndarray, first: Array, resolution: float, points: Array, weights: Array,
              poses: Array) -> Array:  # fmt: skip
    """Weighted sums ``(K,)`` of a field ``(H, W)``, bilinear, zero outside, at points ``(n, 2)`` moved by
    ``(K, 3)``.

    Cell (0, 0) of the field is the lattice cell ``first``, cells are ``resolution`` m.
    """
    out = np.zeros(poses.shape[0])
    for k in range(poses.shape[0]):
        out[k] = _sum_at(field, first, resolution, points, weights, poses[k])
    return out


@njit(cache=True)
def _sum_at(field, first, resolution, points, weights, pose):
    height, width = field.shape
    c, s = np.cos(pose[2]) / resolution, np.sin(pose[2]) / resolution
    x0 = pose[0] / resolution - first[0] - 0.5
    y0 = pose[1] / resolution - first[1] - 0.5
    total = 0.0
    for n in range(points.shape[0]):
        x = c * points[n, 0] - s * points[n, 1] + x0
        y = s * points[n, 0] + c * points[n, 1] + y0
        if 0.0 <= x < width - 1 and 0.0 <= y < height - 1:
            j, i = int(x), int(y)
            u, v = x - j, y - i
            low = (1.0 - u) * field[i, j] + u * field[i, j + 1]
            high = (1.0 - u) * field[i + 1, j] + u * field[i + 1, j + 1]
            total += weights[n] * ((1.0 - v) * low + v * high)
    return total


@njit(cache=True)
def ascend(field_a: np.ndarray, first_a: Array, points_a: Array, weights_a: Array, field_b: np.ndarray,
           first_b: Array, points_b: Array, weights_b: Array, resolution: float, expected: Array,
           information: Array, pose: Array, pivot: Array, step: Array, halvings: int, most: int
           ) -> tuple[Array, float]:  # fmt: skip
    """The top of a score near ``pose (3,)``: the best of six neighbours, as long as it is better, then with
    half the ``step (3,)`` (m, m, rad), ``halvings`` times, at most ``most`` steps each.

    b turns about its point ``pivot (2,)``. The score is what b's points read in ``field_a`` and a's in
    ``field_b``, see `sum_along`, less ½ of the squared distance from ``expected (3,)``, weighed by
    ``information (3, 3)`` in the axes of the expected b.
    """
    step = step.copy()
    at = pose.copy()  # of the pivot
    at[0] += np.cos(pose[2]) * pivot[0] - np.sin(pose[2]) * pivot[1]
    at[1] += np.sin(pose[2]) * pivot[0] + np.cos(pose[2]) * pivot[1]
    best = -np.inf
    trial, there, back, error = at.copy(), np.zeros(3), np.zeros(3), np.zeros(3)
    for _ in range(halvings + 1):
        for _ in range(most + 1):
            chosen = -1
            for k in range(7):
                trial[:] = at
                if k < 6:
                    trial[k % 3] += step[k % 3] if k < 3 else -step[k % 3]
                elif best > -np.inf:
                    break  # where it stands is known but at the start
                c, s = np.cos(trial[2]), np.sin(trial[2])
                there[0] = trial[0] - c * pivot[0] + s * pivot[1]
                there[1] = trial[1] - s * pivot[0] - c * pivot[1]
                there[2] = trial[2]
                back[0] = -c * there[0] - s * there[1]
                back[1] = s * there[0] - c * there[1]
                back[2] = -there[2]
                score = _sum_at(field_a, first_a, resolution, points_b, weights_b, there)
                score += _sum_at(field_b, first_b, resolution, points_a, weights_a, back)
                ce, se = np.cos(expected[2]), np.sin(expected[2])
                dx, dy = there[0] - expected[0], there[1] - expected[1]
                error[0], error[1] = ce * dx + se * dy, ce * dy - se * dx
                error[2] = (there[2] - expected[2] + np.pi) % (2.0 * np.pi) - np.pi
                for i in range(3):
                    for j in range(3):
                        score -= 0.5 * error[i] * information[i, j] * error[j]
                if score > best:
                    best, chosen = score, k
            if chosen < 0 or chosen == 6:
                break
            at[chosen % 3] += step[chosen % 3] if chosen < 3 else -step[chosen % 3]
        step *= 0.5
    c, s = np.cos(at[2]), np.sin(at[2])
    return np.array([at[0] - c * pivot[0] + s * pivot[1], at[1] - s * pivot[0] - c * pivot[1], at[2]]), best


@njit(cache=True)
def straight_runs(occupied: np.ndarray, reach: int, directions: int) -> np.ndarray:
    """Cells ``(H, W)``: how long the longest straight run through each occupied cell is, up to 2 reach + 1.

    A run goes in one of ``directions``, over cells that are occupied or next to one, and ends at the first
    that is not.
    """
    height, width = occupied.shape
    near = np.zeros((height + 2, width + 2), dtype=np.bool_)
    for i in range(height):
        for j in range(width):
            if occupied[i, j]:
                near[i : i + 3, j + 1] = True
                near[i + 1, j : j + 3] = True
    runs = np.zeros((height, width), dtype=np.int32)
    for i in range(height):
        for j in range(width):
            if not occupied[i, j]:
                continue
            for k in range(directions):
                c, s = np.cos(np.pi * k / directions), np.sin(np.pi * k / directions)
                run = 1
                for sign in (-1, 1):
                    for step in range(1, reach + 1):
                        x, y = int(np.round(j + sign * step * c)), int(np.round(i + sign * step * s))
                        if not (0 <= x < width and 0 <= y < height and near[y + 1, x + 1]):
                            break
                        run += 1
                runs[i, j] = max(runs[i, j], run)
                if runs[i, j] == 2 * reach + 1:
                    break
    return runs


@njit(cache=True)
def middle_of_known(points: Array, known: np.ndarray, first: Array, resolution: float, pose: Array) -> Array:
    """Mean ``(2,)`` of the points ``(n, 2)`` that, moved by ``pose (3,)``, lie in cells ``known (H, W)``; of
    all of them when none does."""
    c, s = np.cos(pose[2]), np.sin(pose[2])
    total, everything = np.zeros(3), np.zeros(2)
    for n in range(points.shape[0]):
        everything += points[n]
        j = int(np.floor((c * points[n, 0] - s * points[n, 1] + pose[0]) / resolution) - first[0])
        i = int(np.floor((s * points[n, 0] + c * points[n, 1] + pose[1]) / resolution) - first[1])
        if 0 <= i < known.shape[0] and 0 <= j < known.shape[1] and known[i, j] != 0.0:
            total[0] += points[n, 0]
            total[1] += points[n, 1]
            total[2] += 1.0
    return total[:2] / total[2] if total[2] > 0.0 else everything / points.shape[0]


@njit(cache=True)
def multiply(a: np.ndarray, b: np.ndarray, gain: np.ndarray, alike: float) -> np.ndarray:
    """Transforms ``(2, H, W)`` of agreement and conflict from those of two maps ``(4, H, W)``: walls, free
    space, and the two components of what walls face.

    ``gain (H, W)`` is the blur's; ``alike`` the share of the agreement that facing the same way decides.
    """
    out = np.empty((2, a.shape[1], a.shape[2]), dtype=np.complex64)
    one, other = np.float32(1.0 - alike), np.float32(alike)
    for i in range(a.shape[1]):
        for j in range(a.shape[2]):
            walls, free = np.conj(b[0, i, j]), np.conj(b[1, i, j])
            facing = a[2, i, j] * np.conj(b[2, i, j]) + a[3, i, j] * np.conj(b[3, i, j])
            out[0, i, j] = gain[i, j] * (one * a[0, i, j] * walls + other * facing)
            out[1, i, j] = a[1, i, j] * walls + a[0, i, j] * free
    return out
