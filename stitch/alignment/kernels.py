"""The hot loops of stitching; apart from the rest so that only aligning pays for importing numba."""

from __future__ import annotations

import numpy as np
from numba import njit

from slam.se2 import Array

ONE = np.uint64(1)
"""Added to an unsigned index: a signed one is looked at twice, for being negative."""


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
def energies(points: Array, n_theta: int, first: float, resolution: float, n_rho: int) -> Array:
    """Sums ``(n_theta,)`` of the squared votes of each direction: those of `vote`, which are not kept.

    A bin is one integer, so that a vote is one addition: points in its high bits, the shares of theirs that
    go to the next bin in its low ones, to 2⁻³⁰ or better for fewer than 2¹⁶ points.
    """
    bits, rho_bits = 1, 1  # that hold the number of points, and of bins
    while points.shape[0] >> bits:
        bits += 1
    while n_rho >> rho_bits:
        rho_bits += 1
    fine, start = 62 - max(2 * bits, rho_bits), first / resolution
    scale, share, one = float(1 << fine), (1 << fine) - 1, 1 << (fine + bits)
    bins, out = np.zeros(n_rho, dtype=np.int64), np.zeros(n_theta)
    for k in range(n_theta):
        c, s = np.cos(np.pi * k / n_theta) / resolution, np.sin(np.pi * k / n_theta) / resolution
        c, s, origin = scale * c, scale * s, scale * start
        for j in range(points.shape[0]):
            at = np.int64(points[j, 0] * c + points[j, 1] * s - origin)  # never negative
            bins[np.uint64(at >> fine)] += (at & share) | one
        before, energy = 0.0, 0.0
        for i in range(n_rho):
            held = bins[i]
            if held == 0 and before == 0.0:
                continue
            beyond = (held & (one - 1)) / scale
            votes = (held >> (fine + bits)) - beyond + before
            energy += votes * votes
            before, bins[i] = beyond, 0
        out[k] = energy
    return out


@njit(cache=True, error_model="numpy")
def thin(points: Array, normals: Array, occupied: np.ndarray, origin: Array, side: float,
         resolution: float) -> tuple[Array, Array]:  # fmt: skip
    """Points ``(n, 2)`` on occupied cells, thinned: the mean of those in each cell of ``resolution`` m, and
    the mean of their normals, NaN counting as nothing.

    ``occupied (H, W)`` has cells of ``side`` m and starts at ``origin``. Row by row, as the cells are.
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
    """Which cells of a lattice ``shape`` at ``first`` have their centre on a true cell, once moved by T.

    ``cells (H, W)`` of side ``side`` m start at ``origin``; the lattice has cells of ``resolution`` m.
    """
    c, s = np.cos(T[2]), np.sin(T[2])
    height, width = cells.shape
    x = (first[0] + np.arange(shape[1]) + 0.5) * resolution - T[0]
    along, across = c * x, s * x
    rows, columns = np.empty(shape[1], dtype=np.int32), np.empty(shape[1], dtype=np.int32)
    out = np.zeros(shape, dtype=np.bool_)
    for row in range(shape[0]):
        y = (first[1] + row + 0.5) * resolution - T[1]
        for column in range(shape[1]):  # apart from the reading, so that several are worked out at once
            rows[column] = np.int32(np.floor((c * y - across[column] - origin[1]) / side))
            columns[column] = np.int32(np.floor((along[column] + s * y - origin[0]) / side))
        for column in range(shape[1]):
            i, j = rows[column], columns[column]
            if 0 <= i < height and 0 <= j < width:
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
    xy, room = points.T.copy(), _room(points.shape[0])
    for k in range(poses.shape[0]):
        out[k] = _sum_at(field, first, resolution, xy, weights, poses[k], room)
    return out


@njit(cache=True)
def _room(n):
    """What `_sum_at` needs for n points."""
    return np.empty(n, np.int32), np.empty((3, n))


@njit(cache=True)
def _sum_at(field, first, resolution, xy, weights, pose, room):
    """The sum for one pose; points ``(2, n)``. Where they fall is worked out several at a time, then read."""
    height, width = field.shape
    if height < 2 or width < 2:
        return 0.0
    c, s = np.cos(pose[2]) / resolution, np.sin(pose[2]) / resolution
    x0 = pose[0] / resolution - first[0] - 0.5
    y0 = pose[1] / resolution - first[1] - 0.5
    cells, parts = room
    for n in range(xy.shape[1]):
        x = c * xy[0, n] - s * xy[1, n] + x0
        y = s * xy[0, n] + c * xy[1, n] + y0
        inside = (x >= 0.0) & (x < width - 1.0) & (y >= 0.0) & (y < height - 1.0)
        x, y = x if inside else 0.0, y if inside else 0.0
        i, j = np.int32(y), np.int32(x)
        cells[n] = i * np.int32(width) + j
        parts[0, n], parts[1, n] = x - j, y - i
        parts[2, n] = weights[n] if inside else 0.0
    flat, below, total = field.ravel(), np.uint64(width), 0.0
    for n in range(xy.shape[1]):
        if parts[2, n] == 0.0:
            continue
        k, u, v = np.uint64(np.uint32(cells[n])), parts[0, n], parts[1, n]
        low = (1.0 - u) * flat[k] + u * flat[k + ONE]
        high = (1.0 - u) * flat[k + below] + u * flat[k + below + ONE]
        total += parts[2, n] * ((1.0 - v) * low + v * high)
    return total


@njit(cache=True)
def _lost(pose, expected, information):
    """½ of the squared distance of a pose ``(3,)`` from the one expected, in that one's axes."""
    c, s = np.cos(expected[2]), np.sin(expected[2])
    dx, dy = pose[0] - expected[0], pose[1] - expected[1]
    turn = (pose[2] - expected[2] + np.pi) % (2.0 * np.pi) - np.pi
    error = (c * dx + s * dy, c * dy - s * dx, turn)
    lost = 0.0
    for i in range(3):
        for j in range(3):
            lost += 0.5 * error[i] * information[i, j] * error[j]
    return lost


@njit(cache=True)
def _among(place, places):
    """Is this place ``(3,)`` one of those ``(k, 3)``?"""
    found = False
    for other in places:
        found |= other[0] == place[0] and other[1] == place[1] and other[2] == place[2]
    return found


@njit(cache=True)
def _held_at(at, pivot, pose):
    """Writes the ``pose (3,)`` of b at which its point ``pivot (2,)`` is ``at (3,)``."""
    c, s = np.cos(at[2]), np.sin(at[2])
    pose[0] = at[0] - c * pivot[0] + s * pivot[1]
    pose[1] = at[1] - s * pivot[0] - c * pivot[1]
    pose[2] = at[2]


@njit(cache=True)
def _inverse(pose, back):
    """Writes the pose ``back (3,)`` of a in b."""
    c, s = np.cos(pose[2]), np.sin(pose[2])
    back[0], back[1], back[2] = -c * pose[0] - s * pose[1], s * pose[0] - c * pose[1], -pose[2]


@njit(cache=True)
def ascend(field_a: np.ndarray, first_a: Array, points_a: Array, weights_a: Array, field_b: np.ndarray,
           first_b: Array, points_b: Array, weights_b: Array, resolution: float, expected: Array,
           information: Array, pose: Array, pivot: Array, step: Array, halvings: int, most: int
           ) -> tuple[Array, float]:  # fmt: skip
    """The top of a score near ``pose (3,)``: the best of six neighbours, as long as it is better, then with
    half the ``step (3,)`` (m, m, rad), ``halvings`` times, at most ``most`` steps each.

    b turns about its point ``pivot (2,)``. The score is what b's points read in ``field_a`` and a's in
    ``field_b``, see `sum_along`, less ½ of the squared distance from ``expected (3,)``, weighed by
    ``information (3, 3)`` in the axes of the expected b. ``field_b`` is nowhere above 0: what is not better
    without it is not better with it.
    """
    step, at, best = step.copy(), pose.copy(), -np.inf
    at[0] += np.cos(pose[2]) * pivot[0] - np.sin(pose[2]) * pivot[1]  # of the pivot
    at[1] += np.sin(pose[2]) * pivot[0] + np.cos(pose[2]) * pivot[1]
    trial, there, back = at.copy(), np.zeros(3), np.zeros(3)
    xy_a, xy_b, room = points_a.T.copy(), points_b.T.copy(), _room(max(len(points_a), len(points_b)))
    tried, place = np.empty((6 * most + 7, 3), np.int64), np.empty(3, np.int64)
    for _ in range(halvings + 1):
        place[:], tried[0] = 0, 0  # steps from where this round starts
        count = int(best > -np.inf)  # at first nobody has looked how good the start itself is
        for _ in range(most + 1):
            chosen, chosen_way = -1, 0
            for k in range(6):
                axis, way = k % 3, 1 if k < 3 else -1
                place[axis] += way
                known = _among(place, tried[:count])  # and not better
                tried[count] = place
                place[axis] -= way
                if known:
                    continue
                count += 1
                trial[:] = at
                trial[axis] += way * step[axis]
                _held_at(trial, pivot, there)
                lost = _lost(there, expected, information)
                score = _sum_at(field_a, first_a, resolution, xy_b, weights_b, there, room)
                if score - lost <= best:
                    continue
                _inverse(there, back)
                score += _sum_at(field_b, first_b, resolution, xy_a, weights_a, back, room)
                if score - lost > best:
                    best, chosen, chosen_way = score - lost, axis, way
            if chosen < 0:
                break
            at[chosen] += chosen_way * step[chosen]
            place[chosen] += chosen_way
        step *= 0.5
    _held_at(at, pivot, there)
    return there, best


@njit(cache=True)
def straight_runs(occupied: np.ndarray, reach: int, directions: int) -> np.ndarray:
    """Cells ``(H, W)``: how long a straight run through each occupied cell is: the longest, or the first
    found that is longer than ``reach``; none longer than 2 reach + 1.

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
def multiply(a: np.ndarray, b: np.ndarray, gain: np.ndarray, alike: float, turned: bool = False
             ) -> np.ndarray:  # fmt: skip
    """Transforms ``(2, H, W)`` of agreement and conflict from those of two maps ``(4, H, W)``: walls, free
    space, and the two components of what walls face.

    ``gain (H, W)`` is the blur's; ``alike`` the share of the agreement that facing the same way decides.
    ``turned``: those of b half a turn on, which are the conjugates, of what its walls face less them.
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
