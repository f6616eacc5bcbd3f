"""Measures of how sure the front end is of a step: one function each, larger = worse.

A measure gets the `MatchStatistics` of N scans and returns ``(N,)``. What it makes of NaN, where no match
answered, counts as +inf.
"""

from __future__ import annotations

from collections.abc import Callable, Collection

import numpy as np

from slam import se2
from slam.odometry import combination
from slam.odometry.match_statistics import MatchStatistics
from slam.se2 import Array

FAILURE = (0.2, np.radians(5.0))
"""A step is lost that is off by more than this (m, rad)."""

MOST_VARIANCE = 1e4
"""Variance (m², rad²) that no step has: what is beyond would lose the others to rounding."""

_SCALE = 1.0 / np.array([FAILURE[0], FAILURE[0], FAILURE[1]])


def trace2(statistics: MatchStatistics) -> Array:
    """Trace [m²] of the position block of the covariance (Visser et al.; the thesis's first measure)."""
    return np.abs(statistics.covariance[:, 0, 0] + statistics.covariance[:, 1, 1])


def det2(statistics: MatchStatistics) -> Array:
    """Determinant [m⁴] of the position block (Slamet and Pfingsthorn; the thesis's second measure)."""
    P = statistics.covariance
    return np.abs(P[:, 0, 0] * P[:, 1, 1] - P[:, 0, 1] * P[:, 1, 0])


def neg_matches(statistics: MatchStatistics) -> Array:
    """Minus the number of matched points (the thesis's third measure)."""
    return -statistics.matches


def zero_match(statistics: MatchStatistics) -> Array:
    """Nothing but whether there was a match: the thesis's rule of Experiment 1 as a measure."""
    return 0.0 * statistics.matches


def zero_run2(statistics: MatchStatistics) -> Array:
    """As `zero_match`, but a failure between two matches counts 1: the thesis's rule of Experiment 2."""
    tried = np.flatnonzero(statistics.tried)
    failed = np.concatenate([[False], statistics.failed[tried], [False]])
    alone = failed[1:-1] & ~failed[:-2] & ~failed[2:]
    values = zero_match(statistics)
    values[tried[alone]] = 1.0
    return values


def neg_match_share(statistics: MatchStatistics) -> Array:
    """Minus the share of the scan's points that were matched, so that a short scan is not a bad one."""
    return -statistics.matches / np.maximum(statistics.points, 1.0)


def a_opt(statistics: MatchStatistics) -> Array:
    """A-optimality: mean variance of the step in units of a failure, tr Σ̃ / 3 (Carrillo et al. 2012)."""
    return np.abs(np.trace(scaled(statistics.covariance), axis1=1, axis2=2)) / 3.0


def d_opt(statistics: MatchStatistics) -> Array:
    """D-optimality: volume of the step's covariance in units of a failure, |Σ̃|^⅓ (Carrillo et al. 2012)."""
    return np.cbrt(np.abs(_eigenvalues(scaled(statistics.covariance)).prod(axis=1)))


def e_opt(statistics: MatchStatistics) -> Array:
    """E-optimality: variance of the step's worst direction in units of a failure, λ_max(Σ̃) (Carrillo et al.
    2012)."""
    return np.abs(_eigenvalues(scaled(statistics.covariance))).max(axis=1)


def degeneracy(statistics: MatchStatistics) -> Array:
    """Minus the information about the least known direction, λ_min of the scaled Λ (Zhang et al. 2016)."""
    return -statistics.weakest


def residual_rms(statistics: MatchStatistics) -> Array:
    """Weighted residuals of the pairs, √(Σ eᵀWe / (2n − 3)) (Pfister et al. 2002)."""
    return statistics.residual_rms


def residual_p90(statistics: MatchStatistics) -> Array:
    """Distance [m] of the ninth of ten pairs: what a mean does not tell of a scan that fits in part."""
    return statistics.residual_p90


def misfit(statistics: MatchStatistics) -> Array:
    """Mean χ² over all points of the scan, cut at 9, points without a pair counting half of that."""
    return statistics.misfit


def innovation(statistics: MatchStatistics) -> Array:
    """Squared distance of the match from where dead reckoning expected it, rᵀ(Σ + Σ_INS)⁻¹r.

    What is negative in an indefinite Σ counts as nothing (Bar-Shalom et al. 2001, normalised innovation
    squared).
    """
    distance = np.full(len(statistics.expected), np.nan)
    rows = np.flatnonzero(np.isfinite(statistics.expected).all(axis=1))
    expected = statistics.expected[rows]
    r = se2.log(se2.between(expected, se2.compose(statistics.origin[rows], statistics.matched[rows])))
    values, vectors = np.linalg.eigh(statistics.covariance[rows])
    values = np.clip(values, 0.0, MOST_VARIANCE)
    positive = (vectors * values[:, None, :]) @ np.swapaxes(vectors, 1, 2)
    covariance = positive + se2.to_body_covariance(expected, statistics.expected_covariance[rows])
    distance[rows] = np.sum(r * np.linalg.solve(covariance, r[:, :, None])[:, :, 0], axis=1)
    return distance


def tilt(statistics: MatchStatistics) -> Array:
    """Tilt of the robot [rad] as the INS says, acos(cos φ cos θ) (Formsma §5); none without attitude."""
    return np.arccos(np.cos(statistics.attitude).prod(axis=1))


def iterations(statistics: MatchStatistics) -> Array:
    """Steps until the matcher stopped (Pfister's converges in a few where it knows its place)."""
    return statistics.iterations


def combined(statistics: MatchStatistics) -> Array:
    """Ours: the logarithm of the odds that the step is lost, from the other measures together."""
    return combination.log_odds({name: MEASURES[name](statistics) for name in combination.WEIGHTS})


MEASURES: dict[str, Callable[[MatchStatistics], Array]] = {
    measure.__name__: measure
    for measure in (
        trace2, det2, neg_matches, zero_match, zero_run2, neg_match_share, a_opt, d_opt, e_opt, degeneracy,
        residual_rms, residual_p90, misfit, innovation, tilt, iterations, combined,
    )
}  # fmt: skip


def compute_measures(statistics: MatchStatistics, names: Collection[str] | None = None) -> dict[str, Array]:
    """Every measure, or those of these ``names``, as a column ``(N,)``: +inf where a match was tried and
    failed, NaN where none was tried or there is nothing to measure it by."""
    table = {}
    for name in [name for name in MEASURES if names is None or name in names]:
        values = MEASURES[name](statistics)
        values = np.where(statistics.failed & np.isnan(values), np.inf, values)
        table[name] = np.where(statistics.tried, values, np.nan)
    return table


def scaled(covariance: Array) -> Array:
    """``Σ̃ = DΣD (..., 3, 3)``: in units of `FAILURE`, so that metres and radians may be added."""
    return covariance * np.outer(_SCALE, _SCALE)


def step_error(error: Array) -> Array:
    """How far a relative pose ``(..., 3)`` is from none, in units of `FAILURE`: above 1 a step is lost."""
    return np.maximum(
        np.hypot(error[..., 0], error[..., 1]) / FAILURE[0], np.abs(se2.wrap(error[..., 2])) / FAILURE[1]
    )


def _eigenvalues(matrices: Array) -> Array:
    """Of symmetric ``(N, 3, 3)``, NaN where there is none."""
    found = np.full(matrices.shape[:2], np.nan)
    there = np.isfinite(matrices).all(axis=(1, 2))
    found[there] = np.linalg.eigvalsh(matrices[there])
    return found
