"""From a guess to the best answer: descend, and look elsewhere if it fits badly or leaves a direction open.

Elsewhere is a correlative search in the spirit of Olson, "Real-time correlative scan matching" (2009): points
count where they fall on the smeared points of the reference, for all poses of a window at once. ``settings``
are the `slam.matching.config.KernelSettings`, clouds those of `slam.matching.kernels`.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from slam.matching.config import PLICP, WSM
from slam.matching.covariance import body_covariance, point_to_line_information, residual_quantile
from slam.matching.kernels import alternate, descend, eigh3, pair_covariance, pair_weight

SMEAR = 2
"""Cells to either side over which a point is smeared; its bell has a standard deviation of one cell."""


@njit(cache=True)
def misfit(reference, scan, pairs, pose, cap, same_side):
    """Mean over the scan's points of χ² across the surface, cut at ``cap``; an unpaired point counts half of
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
            total += 0.5 * cap
            continue
        pair = pair_covariance(covariance[j], scan_covariance[i], c, s)
        method = PLICP if np.isfinite(normals[j, 0]) and np.isfinite(scan_normals[i, 0]) else WSM
        xx, xy, yy = pair_weight(method, normals[j], scan_normals[i], pair, c, s, 1.0, True, same_side)
        if xx + yy <= 0.0:
            total += cap
            continue
        ex = points[j, 0] - c * scan_points[i, 0] + s * scan_points[i, 1] - pose[0]
        ey = points[j, 1] - s * scan_points[i, 0] - c * scan_points[i, 1] - pose[1]
        total += min(ex * ex * xx + 2.0 * ex * ey * xy + ey * ey * yy, cap)
    return total / max(len(pairs), 1)


@njit(cache=True)
def smear(points, low, high, cell):
    """Raster (rows, columns) of ``cell`` m from ``low`` to ``high (2,)``: exp(−d²/2cell²) of the distance d
    from each cell to a point of ``points (n, 2)`` nearby. Rows of NaN are no points."""
    reach = SMEAR
    stamp = np.empty((2 * reach + 1, 2 * reach + 1), np.float32)
    for r in range(len(stamp)):
        for c in range(len(stamp)):
            stamp[r, c] = np.exp(-0.5 * ((r - reach) ** 2 + (c - reach) ** 2))
    raster = np.zeros((int((high[1] - low[1]) / cell) + 1, int((high[0] - low[0]) / cell) + 1), np.float32)
    for k in range(len(points)):
        if not np.isfinite(points[k, 0]):
            continue
        column = int(np.floor((points[k, 0] - low[0]) / cell))
        row = int(np.floor((points[k, 1] - low[1]) / cell))
        for r in range(max(0, row - reach), min(len(raster), row + reach + 1)):
            for c in range(max(0, column - reach), min(raster.shape[1], column + reach + 1)):
                raster[r, c] = max(raster[r, c], stamp[r - row + reach, c - column + reach])
    return raster


@njit(cache=True)
def thin_out(points, settings):
    """Those of ``points (n, 2)`` in beam order that are ``search_spacing`` from the one before, about
    ``search_points`` of them, none farther than ``search_range``."""
    rows = np.empty(len(points), np.int64)
    count, last = 0, -1
    for i in range(len(points)):
        if np.hypot(points[i, 0], points[i, 1]) > settings.search_range:
            continue
        gap = np.hypot(points[i, 0] - points[last, 0], points[i, 1] - points[last, 1])
        if last < 0 or gap >= settings.search_spacing:
            rows[count] = i
            count, last = count + 1, i
    return points[rows[: count : max(1, count // settings.search_points)]]


@njit(cache=True)
def correlate(points, scan_points, guess, settings):
    """Score (yaws, rows, columns) of every pose of the window ``guess`` ± ``search_shift``, ``search_turn``.

    A score is the sum of the smeared reference under the scan's points. Steps are ``search_cell`` and
    ``search_angle``, the middle one is ``guess``.
    """
    shift, turn = settings.search_shift, settings.search_turn
    cell, angle = settings.search_cell, settings.search_angle
    half, turns = int(np.ceil(shift / cell)), int(np.ceil(turn / angle))
    side = 2 * half + 1
    reach = np.sqrt(np.max(scan_points[:, 0] ** 2 + scan_points[:, 1] ** 2)) + shift + 3.0 * cell
    low = guess[:2] - reach
    raster = smear(points, low, guess[:2] + reach, cell)
    scores = np.zeros((2 * turns + 1, side, side), np.float32)
    for k in range(2 * turns + 1):
        yaw = guess[2] + (k - turns) * angle
        c, s = np.cos(yaw), np.sin(yaw)
        for i in range(len(scan_points)):
            x = c * scan_points[i, 0] - s * scan_points[i, 1] + guess[0]
            y = s * scan_points[i, 0] + c * scan_points[i, 1] + guess[1]
            column, row = int((x - low[0]) / cell) - half, int((y - low[1]) / cell) - half
            for r in range(side):
                for q in range(side):
                    scores[k, r, q] += raster[row + r, column + q]
    return scores


@njit(cache=True)
def best_apart(scores, guess, settings):
    """Poses (K, 3) of the best scores, ``candidates`` at most, that are not neighbours of a better one;
    scores change."""
    cell, angle, count = settings.search_cell, settings.search_angle, settings.candidates
    turns, half = scores.shape[0] // 2, scores.shape[1] // 2
    poses = np.empty((count, 3))
    for n in range(count):
        at = np.argmax(scores)
        k, rest = at // (scores.shape[1] * scores.shape[2]), at % (scores.shape[1] * scores.shape[2])
        r, q = rest // scores.shape[2], rest % scores.shape[2]
        if scores[k, r, q] <= 0.0:
            return poses[:n]
        poses[n, 0] = guess[0] + (q - half) * cell
        poses[n, 1] = guess[1] + (r - half) * cell
        poses[n, 2] = guess[2] + (k - turns) * angle
        scores[
            max(0, k - settings.apart_angles) : k + settings.apart_angles + 1,
            max(0, r - settings.apart_cells) : r + settings.apart_cells + 1,
            max(0, q - settings.apart_cells) : q + settings.apart_cells + 1,
        ] = 0.0
    return poses


@njit(cache=True)
def find_best(method, reference, scan, guess, prior, settings, levels, still):
    """The best answer near ``guess (3,)``: (pose, Λ, pairs used, cost, iterations, converged), its pairs
    (n,), misfit, spread (3, 3) and the number of answers compared.

    ``reference`` and ``scan`` are indexed clouds, ``prior (3, 3)`` information about the guess, ``levels (L,
    2)`` those of `slam.matching.config.MatchConfig`. ``still`` also tries the identity: a robot at rest may
    log the same points again. The spread is that of the other answers about the best, by their likelihoods:
    additive errors in the reference frame.
    """
    shift, turn = settings.search_shift, settings.search_turn
    pairs = np.full(len(scan[0][0]), -1, np.int64)
    answer = descend(method, reference, scan, guess, guess, prior, settings, levels, pairs)
    fine = levels[min(1, len(levels) - 1) :]  # another answer starts nearer than the guess
    poses, costs = np.empty((0, 3)), np.empty(0)
    fit = misfit(reference[0], scan[0], pairs, answer[0], settings.misfit_cap, settings.same_side)
    if shift <= 0.0:
        return answer, pairs, fit, np.zeros((3, 3)), 1
    thin = thin_out(scan[0][0], settings)
    if len(thin) > 0 and (answer[2] < settings.least_share * len(pairs) or fit > settings.most_misfit):
        starts = best_apart(correlate(reference[0][0], thin, guess, settings), guess, settings)
        answer, pairs, poses, costs = _compare(
            method, reference, scan, starts, guess, prior, settings, fine, answer, pairs, poses, costs
        )
    starts = _open_starts(reference, scan, answer, pairs, prior, settings)
    if len(starts) > 0:
        answer, pairs, poses, costs = _compare(
            method, reference, scan, starts, guess, prior, settings, fine, answer, pairs, poses, costs
        )
        if still and np.hypot(guess[0], guess[1]) < shift and abs(guess[2]) < turn:
            others = np.full(len(pairs), -1, np.int64)
            other = descend(method, reference, scan, np.zeros(3), guess, prior, settings, fine[-1:], others)
            fit = misfit(reference[0], scan[0], others, other[0], settings.misfit_cap, settings.same_side)
            if fit < settings.same_scan:
                answer, pairs = other, others
    fit = misfit(reference[0], scan[0], pairs, answer[0], settings.misfit_cap, settings.same_side)
    best = _total(reference, scan, pairs, answer[0], guess, prior, settings)
    spread = spread_of(poses, costs, answer[0], best, settings.correlated_points)
    return answer, pairs, fit, spread, 1 + len(poses)


@njit(cache=True)
def _total(reference, scan, pairs, pose, guess, prior, settings):
    """Cost of an answer: the summed misfits of all points, and the squared distance from the prior."""
    fit = misfit(reference[0], scan[0], pairs, pose, settings.misfit_cap, settings.same_side)
    return len(pairs) * fit + (pose - guess) @ prior @ (pose - guess)


@njit(cache=True)
def _compare(method, reference, scan, starts, guess, prior, settings, levels, answer, pairs, poses, costs):
    """Descend from each of the starts (K, 3); the answer and pairs that are best by a margin, and the list
    of poses and totals with the new ones."""
    best = _total(reference, scan, pairs, answer[0], guess, prior, settings)
    ends, totals = np.empty((len(starts), 3)), np.full(len(starts), np.inf)
    for k in range(len(starts)):
        others = np.full(len(pairs), -1, np.int64)
        other = descend(method, reference, scan, starts[k], guess, prior, settings, levels, others)
        ends[k] = other[0]
        totals[k] = _total(reference, scan, others, other[0], guess, prior, settings)
        if totals[k] < best - settings.margin:
            ends[k], totals[k], best = answer[0], best, totals[k]
            answer, pairs = other, others
    return answer, pairs, np.concatenate((poses, ends)), np.concatenate((costs, totals))


@njit(cache=True)
def _open_starts(reference, scan, answer, pairs, prior, settings):
    """Poses (K, 3) along the direction that neither the walls' normals nor the prior decide; none if all
    are."""
    scale = np.array([1.0, 1.0, 1.0 / settings.length])
    known = prior + point_to_line_information(
        reference[0], scan[0], pairs, answer[0], settings.robust, settings.same_side
    )
    values, vectors = eigh3(known * np.outer(scale, scale))
    if values[0] >= settings.open_direction * answer[2]:
        return np.empty((0, 3))
    steps = min(settings.open_steps, int(settings.search_shift / settings.open_step))
    starts = np.empty((2 * steps, 3))
    for k in range(steps):
        starts[2 * k] = answer[0] + (k + 1) * settings.open_step * vectors[:, 0] * scale
        starts[2 * k + 1] = answer[0] - (k + 1) * settings.open_step * vectors[:, 0] * scale
    return starts


@njit(cache=True)
def spread_of(poses, costs, pose, cost, correlated_points):
    """Second moment (3, 3) of other answers ``poses (K, 3)`` about the best ``pose``, each weighted by exp(−½
    Δcost / correlated_points)."""
    spread, total = np.zeros((3, 3)), 1.0
    for k in range(len(poses)):
        weight = np.exp(-0.5 * max(costs[k] - cost, 0.0) / correlated_points)
        apart = poses[k] - pose
        apart[2] = (apart[2] + np.pi) % (2.0 * np.pi) - np.pi
        spread += weight * np.outer(apart, apart)
        total += weight
    return spread / total


@njit(cache=True)
def solve(method, mode, alternating, reference, scan, guess, prior, settings, levels, still):
    """A whole match in one call: answer (pose, Λ, pairs used, cost, iterations, converged), misfit, the
    distance [m] that nine of ten pairs do not exceed, covariance (3, 3) in the body frame of the scan,
    eigenvalues (3,) of the information, and the number of answers compared.

    Arguments as in `find_best`; ``mode`` is an index of `slam.matching.config.COVARIANCE_MODES`.
    """
    if alternating:
        pairs = np.full(len(scan[0][0]), -1, np.int64)
        answer = alternate(method, reference, scan, guess, settings, levels[-1, 0], pairs)
        fit = misfit(reference[0], scan[0], pairs, answer[0], settings.misfit_cap, settings.same_side)
        spread, tried = np.zeros((3, 3)), 1
    else:
        answer, pairs, fit, spread, tried = find_best(
            method, reference, scan, guess, prior, settings, levels, still
        )
    covariance, eigenvalues = body_covariance(
        mode, reference[0], scan[0], pairs, answer[0], answer[1], prior, spread, settings
    )
    p90 = residual_quantile(reference[0], scan[0], pairs, answer[0], 0.9)
    return answer, fit, p90, covariance, eigenvalues, tried
