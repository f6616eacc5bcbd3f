"""Other answers than the nearest one: how badly a pose fits, and where else a scan might fit.

A correlative search in the spirit of Olson, "Real-time correlative scan matching" (2009): points count where
they fall on the smeared points of the reference, for all poses of a window at once.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from slam.matching.kernels import PLICP, WSM, pair_covariance, pair_weight

CAP = 9.0
"""χ² of a point that fits nowhere."""

CELL, ANGLE = 0.1, np.radians(2.0)
"""Steps [m, rad] of the correlative search."""

APART, APART_ANGLE = 2, 3
"""Steps within which a score is taken for the shoulder of a better one."""

FARTHEST = 40.0
"""Range [m] beyond which a point is not searched with: the raster grows with its square."""

THIN, MOST_POINTS = 0.1, 90
"""Distance [m] of the scan's points that are looked at, and about how many they are at most."""


@njit(cache=True)
def misfit(reference, scan, pairs, pose):
    """Mean over the scan's points of χ² across the surface, cut at `CAP`; an unpaired point counts half of
    it: it may be hidden from the reference, or contradict it.

    ``reference`` and ``scan`` are clouds. A pair without both normals counts by its distance.
    """
    points, normals, covariance, _ = reference
    scan_points, scan_normals, scan_covariance, _ = scan
    c, s = np.cos(pose[2]), np.sin(pose[2])
    total = 0.0
    for i in range(len(pairs)):
        j = pairs[i]
        if j < 0:
            total += 0.5 * CAP
            continue
        pair = pair_covariance(covariance[j], scan_covariance[i], c, s)
        method = PLICP if np.isfinite(normals[j, 0]) and np.isfinite(scan_normals[i, 0]) else WSM
        xx, xy, yy = pair_weight(method, normals[j], scan_normals[i], pair, c, s, 1.0, True)
        if xx + yy <= 0.0:
            total += CAP
            continue
        ex = points[j, 0] - c * scan_points[i, 0] + s * scan_points[i, 1] - pose[0]
        ey = points[j, 1] - s * scan_points[i, 0] - c * scan_points[i, 1] - pose[1]
        total += min(ex * ex * xx + 2.0 * ex * ey * xy + ey * ey * yy, CAP)
    return total / max(len(pairs), 1)


@njit(cache=True)
def smear(points, low, high):
    """Raster (rows, columns) of `CELL` m from ``low`` to ``high (2,)``: exp(−d²/2CELL²) of the distance d
    from each cell to a point of ``points (n, 2)`` nearby. Rows of NaN are no points."""
    reach = 2
    stamp = np.empty((2 * reach + 1, 2 * reach + 1), np.float32)
    for r in range(len(stamp)):
        for c in range(len(stamp)):
            stamp[r, c] = np.exp(-0.5 * ((r - reach) ** 2 + (c - reach) ** 2))
    raster = np.zeros((int((high[1] - low[1]) / CELL) + 1, int((high[0] - low[0]) / CELL) + 1), np.float32)
    for k in range(len(points)):
        if not np.isfinite(points[k, 0]):
            continue
        column = int(np.floor((points[k, 0] - low[0]) / CELL))
        row = int(np.floor((points[k, 1] - low[1]) / CELL))
        for r in range(max(0, row - reach), min(len(raster), row + reach + 1)):
            for c in range(max(0, column - reach), min(raster.shape[1], column + reach + 1)):
                raster[r, c] = max(raster[r, c], stamp[r - row + reach, c - column + reach])
    return raster


@njit(cache=True)
def thinned(points):
    """Those of ``points (n, 2)`` in beam order that are `THIN` m from the one before, and no farther than
    `FARTHEST`."""
    rows = np.empty(len(points), np.int64)
    count, last = 0, -1
    for i in range(len(points)):
        if np.hypot(points[i, 0], points[i, 1]) > FARTHEST:
            continue
        if last < 0 or np.hypot(points[i, 0] - points[last, 0], points[i, 1] - points[last, 1]) >= THIN:
            rows[count] = i
            count += 1
            last = i
    return points[rows[: count : max(1, count // MOST_POINTS)]]


@njit(cache=True)
def correlate(points, scan_points, guess, shift, turn):
    """Score (yaws, rows, columns) of every pose of the window ``guess`` ± ``shift`` m, ``turn`` rad.

    A score is the sum of the smeared reference under the scan's points. Steps are `CELL` and `ANGLE`, the
    middle one is ``guess``.
    """
    half, turns = int(np.ceil(shift / CELL)), int(np.ceil(turn / ANGLE))
    side = 2 * half + 1
    reach = np.sqrt(np.max(scan_points[:, 0] ** 2 + scan_points[:, 1] ** 2)) + shift + 3.0 * CELL
    low = guess[:2] - reach
    raster = smear(points, low, guess[:2] + reach)
    scores = np.zeros((2 * turns + 1, side, side), np.float32)
    for k in range(2 * turns + 1):
        yaw = guess[2] + (k - turns) * ANGLE
        c, s = np.cos(yaw), np.sin(yaw)
        for i in range(len(scan_points)):
            x = c * scan_points[i, 0] - s * scan_points[i, 1] + guess[0]
            y = s * scan_points[i, 0] + c * scan_points[i, 1] + guess[1]
            column, row = int((x - low[0]) / CELL) - half, int((y - low[1]) / CELL) - half
            for r in range(side):
                for q in range(side):
                    scores[k, r, q] += raster[row + r, column + q]
    return scores


@njit(cache=True)
def best_apart(scores, guess, count):
    """Poses (K, 3) of the ``count`` best scores that are not neighbours of a better one; scores change."""
    turns, half = scores.shape[0] // 2, scores.shape[1] // 2
    poses = np.empty((count, 3))
    for n in range(count):
        at = np.argmax(scores)
        k, rest = at // (scores.shape[1] * scores.shape[2]), at % (scores.shape[1] * scores.shape[2])
        r, q = rest // scores.shape[2], rest % scores.shape[2]
        if scores[k, r, q] <= 0.0:
            return poses[:n]
        poses[n, 0] = guess[0] + (q - half) * CELL
        poses[n, 1] = guess[1] + (r - half) * CELL
        poses[n, 2] = guess[2] + (k - turns) * ANGLE
        scores[
            max(0, k - APART_ANGLE) : k + APART_ANGLE + 1,
            max(0, r - APART) : r + APART + 1,
            max(0, q - APART) : q + APART + 1,
        ] = 0.0
    return poses
