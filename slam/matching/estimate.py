"""From a guess to the best answer: descend, and look elsewhere when the answer fits badly or says little."""

from __future__ import annotations

import numpy as np
from numba import njit

from slam.matching.covariance import point_to_line_information
from slam.matching.kernels import descend
from slam.matching.search import best_apart, correlate, misfit, thinned
from slam.matching.symmetric import eigh3

CANDIDATES = 5
"""Answers of the correlative search that are followed up."""

STEP, MOST_STEPS = 0.1, 4
"""Starts along an open direction, to either side [m, or rad times the length]."""

SAME_SCAN = 1e-3
"""Misfit of a scan with itself: below it, noise and all, the robot stood still and saw the same points."""

SHARED = 10.0
"""Points that share one error: how much less a difference of misfits says than if points were independent."""


@njit(cache=True)
def estimate(method, reference, scan, guess, prior, descent, levels, search, still):
    """The best answer near ``guess (3,)``: (pose, Λ, pairs used, cost, iterations, converged), its pairs
    (n,), misfit, spread (3, 3) and the number of answers compared.

    ``reference`` and ``scan`` are indexed clouds, ``prior (3, 3)`` information about the guess; ``descent``,
    ``levels`` and ``search`` those of `slam.matching.config.MatchConfig`. ``still`` also tries the identity:
    a robot at rest may log the same points again. The spread is that of the other answers about the best, by
    their likelihoods: additive errors in the reference frame.
    """
    shift, turn, least_share, most_misfit, open_direction, margin = search
    pairs = np.full(len(scan[0][0]), -1, np.int64)
    answer = descend(method, reference, scan, guess, guess, prior, descent, levels, pairs)
    fine = levels[min(1, len(levels) - 1) :]  # another answer starts nearer than the guess
    poses, costs = np.empty((0, 3)), np.empty(0)
    fits = misfit(reference[0], scan[0], pairs, answer[0])
    if shift <= 0.0:
        return answer, pairs, fits, np.zeros((3, 3)), 1
    some = thinned(scan[0][0])
    if len(some) > 0 and (answer[2] < least_share * len(pairs) or fits > most_misfit):
        scores = correlate(reference[0][0], some, guess, shift, turn)
        starts = best_apart(scores, guess, CANDIDATES)
        answer, pairs, poses, costs = _compare(
            method, reference, scan, starts, guess, prior, descent, fine, margin, answer, pairs, poses, costs
        )
    starts = _open_starts(reference, scan, answer, pairs, prior, descent, open_direction, shift)
    if len(starts) > 0:
        answer, pairs, poses, costs = _compare(
            method, reference, scan, starts, guess, prior, descent, fine, margin, answer, pairs, poses, costs
        )
        if still and np.hypot(guess[0], guess[1]) < shift and abs(guess[2]) < turn:
            others = np.full(len(pairs), -1, np.int64)
            other = descend(method, reference, scan, np.zeros(3), guess, prior, descent, fine[-1:], others)
            if misfit(reference[0], scan[0], others, other[0]) < SAME_SCAN:
                answer, pairs = other, others
    fits = misfit(reference[0], scan[0], pairs, answer[0])
    best = _total(reference, scan, pairs, answer[0], guess, prior)
    return answer, pairs, fits, _spread(poses, costs, answer[0], best), 1 + len(poses)


@njit(cache=True)
def _total(reference, scan, pairs, pose, guess, prior):
    """What is to be least: the misfits of all points, and the distance from the guess where it is known."""
    return len(pairs) * misfit(reference[0], scan[0], pairs, pose) + (pose - guess) @ prior @ (pose - guess)


@njit(cache=True)
def _compare(
    method, reference, scan, starts, guess, prior, descent, levels, margin, answer, pairs, poses, costs
):
    """Descend from each of the starts (K, 3); the answer and pairs that are best by a margin, and the list
    of poses and totals with the new ones."""
    best = _total(reference, scan, pairs, answer[0], guess, prior)
    found, totals = np.empty((len(starts), 3)), np.full(len(starts), np.inf)
    for k in range(len(starts)):
        others = np.full(len(pairs), -1, np.int64)
        other = descend(method, reference, scan, starts[k], guess, prior, descent, levels, others)
        found[k] = other[0]
        totals[k] = _total(reference, scan, others, other[0], guess, prior)
        if totals[k] < best - margin:
            found[k], totals[k], best = answer[0], best, totals[k]
            answer, pairs = other, others
    return answer, pairs, np.concatenate((poses, found)), np.concatenate((costs, totals))


@njit(cache=True)
def _open_starts(reference, scan, answer, pairs, prior, descent, open_direction, shift):
    """Poses (K, 3) along the direction that neither the walls' normals nor the prior decide; none if all
    are."""
    scale = np.array([1.0, 1.0, 1.0 / descent[3]])
    known = point_to_line_information(reference[0], scan[0], pairs, answer[0], descent[1]) + prior
    values, vectors = eigh3(known * np.outer(scale, scale))
    if values[0] >= open_direction * answer[2]:
        return np.empty((0, 3))
    steps = min(MOST_STEPS, int(shift / STEP))
    starts = np.empty((2 * steps, 3))
    for k in range(steps):
        starts[2 * k] = answer[0] + (k + 1) * STEP * vectors[:, 0] * scale
        starts[2 * k + 1] = answer[0] - (k + 1) * STEP * vectors[:, 0] * scale
    return starts


@njit(cache=True)
def _spread(poses, costs, pose, cost):
    """Second moment (3, 3) of the other answers (K, 3) about the best, weighted by exp(−½ Δcost / SHARED)."""
    spread, total = np.zeros((3, 3)), 1.0
    for k in range(len(poses)):
        weight = np.exp(-0.5 * max(costs[k] - cost, 0.0) / SHARED)
        apart = poses[k] - pose
        apart[2] = (apart[2] + np.pi) % (2.0 * np.pi) - np.pi
        spread += weight * np.outer(apart, apart)
        total += weight
    return spread / total
