"""The score of an alignment as a sum over wall points, and the climb to its top."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from slam.se2 import Array

ONE = np.uint64(1)
"""``index + 1`` with a signed 1 would make numba check for negative indices."""


class Layer(NamedTuple):
    """A field over one map, and the wall points of the other map that read it.

    ``field (H, W)``, whose cell (0, 0) is the lattice cell ``first (2,)``, with cells of ``resolution`` m;
    ``points (n, 2)`` m in the other map's frame, with ``weights (n,)``.
    """

    field: np.ndarray
    first: Array
    resolution: float
    points: Array
    weights: Array


class QuadraticPrior(NamedTuple):
    """Half a squared distance from ``expected (3,)``, in its own axes, by ``information (3, 3)``."""

    expected: Array
    information: Array


@njit(cache=True)
def sum_along(layer: Layer, poses: Array) -> Array:
    """Weighted sums ``(K,)`` of a field (bilinear, zero outside) at the points moved by ``poses (K, 3)``."""
    out = np.zeros(poses.shape[0])
    xy, scratch = layer.points.T.copy(), _scratch(layer.points.shape[0])
    for k in range(poses.shape[0]):
        out[k] = _sum_at(layer, xy, poses[k], scratch)
    return out


@njit(cache=True)
def _scratch(n):
    """Memory that `_sum_at` needs for n points."""
    return np.empty(n, np.int32), np.empty((3, n))


@njit(cache=True)
def _sum_at(layer, xy, pose, scratch):
    """The sum for one pose; ``xy (2, n)`` are the points. Cells are computed first, vectorised, then read."""
    field, first, resolution, _, weights = layer  # as locals: a field read in a loop is not vectorised
    height, width = field.shape
    if height < 2 or width < 2:
        return 0.0
    c, s = np.cos(pose[2]) / resolution, np.sin(pose[2]) / resolution
    x0 = pose[0] / resolution - first[0] - 0.5
    y0 = pose[1] / resolution - first[1] - 0.5
    cells, parts = scratch
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
def _prior_loss(pose, prior):
    """What a pose ``(3,)`` loses by a `QuadraticPrior`."""
    expected = prior.expected
    c, s = np.cos(expected[2]), np.sin(expected[2])
    dx, dy = pose[0] - expected[0], pose[1] - expected[1]
    turn = (pose[2] - expected[2] + np.pi) % (2.0 * np.pi) - np.pi
    error = (c * dx + s * dy, c * dy - s * dx, turn)
    loss = 0.0
    for i in range(3):
        for j in range(3):
            loss += 0.5 * error[i] * prior.information[i, j] * error[j]
    return loss


@njit(cache=True)
def _contains(places, place):
    """Is ``place (3,)`` one of ``places (k, 3)``?"""
    found = False
    for other in places:
        found |= other[0] == place[0] and other[1] == place[1] and other[2] == place[2]
    return found


@njit(cache=True)
def _pose_from_pivot(T_a_pivot, pivot, pose):
    """Writes the ``pose (3,)`` of b whose point ``pivot (2,)`` lies at ``T_a_pivot (3,)``."""
    c, s = np.cos(T_a_pivot[2]), np.sin(T_a_pivot[2])
    pose[0] = T_a_pivot[0] - c * pivot[0] + s * pivot[1]
    pose[1] = T_a_pivot[1] - s * pivot[0] - c * pivot[1]
    pose[2] = T_a_pivot[2]


@njit(cache=True)
def _invert(pose, inverse):
    """Writes the ``inverse (3,)`` of a pose ``(3,)``."""
    c, s = np.cos(pose[2]), np.sin(pose[2])
    inverse[0], inverse[1], inverse[2] = -c * pose[0] - s * pose[1], s * pose[0] - c * pose[1], -pose[2]


@njit(cache=True)
def hill_climb(over_a: Layer, over_b: Layer, prior: QuadraticPrior, T_a_b: Array, pivot: Array, step: Array,
               halvings: int, max_steps: int) -> tuple[Array, float]:  # fmt: skip
    """The local maximum of the score near ``T_a_b (3,)``, and the score there.

    Moves to the best of the six neighbours at ``step (3,)`` (m, m, rad) as long as that is better, at most
    ``max_steps`` times; then with half the step, ``halvings`` times. b turns about its point ``pivot (2,)``.

    The score is `sum_along` of ``over_a`` (read by b's points) and of ``over_b`` (read by a's points), less
    the prior's loss. The field of ``over_b`` must be nowhere positive: then a pose that is not better
    without it is not better with it, and it need not be summed.
    """
    step, at, best = step.copy(), T_a_b.copy(), -np.inf
    at[0] += np.cos(T_a_b[2]) * pivot[0] - np.sin(T_a_b[2]) * pivot[1]  # of the pivot
    at[1] += np.sin(T_a_b[2]) * pivot[0] + np.cos(T_a_b[2]) * pivot[1]
    trial, pose, inverse = at.copy(), np.zeros(3), np.zeros(3)
    xy_b, xy_a = over_a.points.T.copy(), over_b.points.T.copy()
    scratch = _scratch(max(len(over_a.points), len(over_b.points)))
    tried, place = np.empty((6 * max_steps + 7, 3), np.int64), np.empty(3, np.int64)
    for _ in range(halvings + 1):
        place[:], tried[0] = 0, 0  # steps from where this round starts
        count = int(best > -np.inf)  # the start itself has not been scored in the first round
        for _ in range(max_steps + 1):
            chosen, chosen_way = -1, 0
            for k in range(6):
                axis, way = k % 3, 1 if k < 3 else -1
                place[axis] += way
                known = _contains(tried[:count], place)  # and not better
                tried[count] = place
                place[axis] -= way
                if known:
                    continue
                count += 1
                trial[:] = at
                trial[axis] += way * step[axis]
                _pose_from_pivot(trial, pivot, pose)
                loss = _prior_loss(pose, prior)
                score = _sum_at(over_a, xy_b, pose, scratch)
                if score - loss <= best:
                    continue
                _invert(pose, inverse)
                score += _sum_at(over_b, xy_a, inverse, scratch)
                if score - loss > best:
                    best, chosen, chosen_way = score - loss, axis, way
            if chosen < 0:
                break
            at[chosen] += chosen_way * step[chosen]
            place[chosen] += chosen_way
        step *= 0.5
    _pose_from_pivot(at, pivot, pose)
    return pose, best


@njit(cache=True)
def mean_of_known(layer: Layer, pose: Array) -> Array:
    """Mean ``(2,)`` of a layer's points that, moved by ``pose (3,)``, lie in cells of its field that are not
    zero; of all of them when none does."""
    c, s = np.cos(pose[2]), np.sin(pose[2])
    known, first, resolution, points, _ = layer
    total, everything = np.zeros(3), np.zeros(2)
    for n in range(points.shape[0]):
        everything += points[n]
        x, y = c * points[n, 0] - s * points[n, 1] + pose[0], s * points[n, 0] + c * points[n, 1] + pose[1]
        j = int(np.floor(x / resolution) - first[0])
        i = int(np.floor(y / resolution) - first[1])
        if 0 <= i < known.shape[0] and 0 <= j < known.shape[1] and known[i, j] != 0.0:
            total[0] += points[n, 0]
            total[1] += points[n, 1]
            total[2] += 1.0
    return total[:2] / total[2] if total[2] > 0.0 else everything / points.shape[0]
