"""Scores of a matcher: success, silence about failures, consistency, error, time."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.stats import binomtest, chi2

from scenarios.bench.matching.pairs import Pair
from scenarios.stages import timed
from slam import se2
from slam.matching import Match, NoMatch
from slam.se2 import Array

LIMIT = (0.10, math.radians(2.0))
"""Error [m, rad] up to which an answer is a success."""
COVERED_SHARE = 0.9973
"""An error is covered up to the χ² that this share of honest ones stays under: three standard deviations."""
SINGULAR = 1e-12
"""Variance [m², rad²] added to what is claimed: UsarCommander's covariance can be singular. It can also be so
large (10¹²) that its smaller directions are lost to rounding; those then claim nothing."""


@dataclass(frozen=True)
class PoseEstimate:
    """Where a matcher puts a scan ``(3,)``, and the covariance ``(3, 3)`` that it claims, if any."""

    T_reference_scan: Array
    covariance: Array | None


Result = PoseEstimate | Match | NoMatch


@dataclass(frozen=True)
class Matcher:
    """A matcher in three steps, which are timed apart."""

    read: Callable[[Pair, int], Any]
    """From the ranges of one of a pair's scans (0 the reference, 1 the other); not timed in the scores."""
    prepare: Callable[[Any], Any]
    """What is made of a scan once, and could be kept for many matches: index, covariances."""
    match: Callable[[Any, Any, Array], Result]
    """Two prepared scans, from a guess ``(3,)``."""

    def prepare_and_match(self, reference: Any, scan: Any, guess: Array) -> Result:
        """Two scans, from a guess ``(3,)``."""
        return self.match(self.prepare(reference), self.prepare(scan), guess)


@dataclass(frozen=True)
class Score:
    """Shares of all pairs, with Wilson's 95 % interval for the successes, and figures of the answers.

    ``silent``: pairs answered beyond the limits with an error that the claimed covariance does not cover: ξ =
    log(T̂⁻¹ T_true), body tangent, has ξᵀ(Σ + Σ_truth)⁻¹ξ > 14.16 (χ²₃ at 99.73 %). ``anees`` is the mean of
    that over all answers / 3, ``anees_median`` its median / 2.366, which a few failures cannot move. None
    where a matcher claims no covariance, or there is nothing to take the mean of. ``rms_m`` and ``rms_rad``
    are of the successes; ``ms``, the median, and ``ms_95`` are processor time per call, of all pairs.
    """

    pairs: int
    success: float
    success_low: float
    success_high: float
    silent: float | None
    no_match: float
    anees: float | None
    anees_median: float | None
    rms_m: float | None
    rms_rad: float | None
    ms: float
    ms_95: float


def match_all(matcher: Matcher, pairs: Sequence[Pair], guesses: Array) -> tuple[list[Result], Array]:
    """A matcher's result for every pair, and the processor time ``(N,)`` s of each."""
    both = [
        timed(matcher.prepare_and_match, *(matcher.read(pair, which) for which in (0, 1)), guess)
        for pair, guess in zip(pairs, guesses, strict=True)
    ]
    return [result for result, _ in both], np.array([seconds for _, seconds in both])


def measure(matcher: Matcher, pairs: Sequence[Pair], guesses: Array) -> Score:
    """The score of a matcher over all pairs."""
    return score(pairs, *match_all(matcher, pairs, guesses))


def score(pairs: Sequence[Pair], results: Sequence[Result], seconds: Array) -> Score:
    """Score one result per pair. Raises ``ValueError`` when there are no pairs."""
    if not pairs:
        raise ValueError("expected at least one pair")
    n = len(pairs)
    matched, errors = matches_and_errors(pairs, results)
    good = within_limits(errors)
    nees = np.array([normalised(e, p, a) for e, (p, a) in zip(errors, matched, strict=True)])
    claimed = not np.any(np.isnan(nees))
    interval = binomtest(int(good.sum()), n).proportion_ci(method="wilson")
    return Score(
        pairs=n,
        success=float(good.sum()) / n,
        success_low=float(interval.low),
        success_high=float(interval.high),
        silent=float(np.sum(~good & (nees > chi2.ppf(COVERED_SHARE, 3)))) / n if claimed else None,
        no_match=1.0 - len(matched) / n,
        anees=_or_none(np.mean, nees / 3.0) if claimed else None,
        anees_median=_or_none(np.median, nees / chi2.median(3)) if claimed else None,
        rms_m=_or_none(_rms, np.hypot(errors[good, 0], errors[good, 1])),
        rms_rad=_or_none(_rms, errors[good, 2]),
        ms=1e3 * float(np.median(seconds)),
        ms_95=1e3 * float(np.percentile(seconds, 95.0)),
    )


def matches_and_errors(
    pairs: Sequence[Pair], results: Sequence[Result]
) -> tuple[list[tuple[Pair, PoseEstimate | Match]], Array]:
    """Pairs that were matched, with the match, and ξ ``(N, 3)`` with T_true = T̂ ∘ exp(ξ): the tangent space a
    match's covariance is in."""
    both = zip(pairs, results, strict=True)
    matched = [(pair, result) for pair, result in both if not isinstance(result, NoMatch)]
    errors = [se2.log(se2.between(match.T_reference_scan, pair.T_reference_scan)) for pair, match in matched]
    return matched, np.array(errors).reshape(-1, 3)


def within_limits(errors: Array) -> np.ndarray:
    """Which of the errors ``(N, 3)`` are successes."""
    distance, angle = LIMIT
    return (np.hypot(errors[:, 0], errors[:, 1]) <= distance) & (np.abs(errors[:, 2]) <= angle)


def normalised(xi: Array, pair: Pair, estimate: PoseEstimate | Match) -> float:
    """ξᵀ(Σ + Σ_truth)⁻¹ξ: the squared error in standard deviations; NaN where no covariance is claimed."""
    if estimate.covariance is None:
        return float("nan")
    claimed = estimate.covariance + pair.truth_covariance + SINGULAR * np.eye(3)
    return float(xi @ np.linalg.pinv(claimed, hermitian=True) @ xi)


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _or_none(statistic: Callable[[Array], object], values: Array) -> float | None:
    return float(statistic(values)) if len(values) else None  # type: ignore[arg-type]
