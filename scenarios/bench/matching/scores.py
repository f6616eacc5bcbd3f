"""What a matcher's answers are worth: success, silence about failures, consistency, error, time."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from statistics import NormalDist
from typing import Any

import numpy as np

from scenarios.bench.matching.pairs import Pair
from slam import se2
from slam.matching import Match, NoMatch
from slam.se2 import Array

LIMIT = (0.10, math.radians(2.0))
"""Error [m, rad] up to which an answer is a success."""
COVERED = 14.156
"""χ² of three degrees of freedom that 99.73 % (three standard deviations) stay under."""
CHI2_MEDIAN = 2.366
"""Median of χ² of three degrees of freedom."""
CONFIDENCE = 0.95
SINGULAR = 1e-12
"""Variance [m², rad²] added to what is claimed: UsarCommander's covariance can be singular. It can also be so
large (10¹²) that its smaller directions are lost to rounding; those then claim nothing."""


@dataclass(frozen=True)
class Answer:
    """Where a matcher puts a scan ``(3,)``, and the covariance ``(3, 3)`` it claims, None if it claims
    none."""

    T_reference_scan: Array
    covariance: Array | None


@dataclass(frozen=True)
class Matcher:
    """How to ask somebody for a match, in the three steps whose times differ in what they belong to.

    ``given``: what it takes, from the ranges of one of a pair's scans (0 the reference, 1 the other), not
    timed in the scores; ``ready``: what it makes of that once, and could keep for many matches; ``answer``:
    the match of two such, from a guess ``(3,)``.
    """

    given: Callable[[Pair, int], Any]
    ready: Callable[[Any], Any]
    answer: Callable[[Any, Any, Array], Answer | Match | NoMatch]


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


def ask(
    matcher: Matcher, pairs: Sequence[Pair], guesses: Array
) -> tuple[list[Answer | Match | NoMatch], Array]:
    """A matcher's answer for every pair, and the processor time ``(N,)`` s of each."""
    answers, seconds = [], []
    for pair, guess in zip(pairs, guesses, strict=True):
        reference, scan = (matcher.given(pair, which) for which in (0, 1))
        started = time.process_time()
        answers.append(matcher.answer(matcher.ready(reference), matcher.ready(scan), guess))
        seconds.append(time.process_time() - started)
    return answers, np.array(seconds)


def measure(matcher: Matcher, pairs: Sequence[Pair], guesses: Array) -> Score:
    """The score of a matcher, asked for every pair."""
    return score(pairs, *ask(matcher, pairs, guesses))


def score(pairs: Sequence[Pair], answers: Sequence[Answer | Match | NoMatch], seconds: Array) -> Score:
    """Score one answer per pair. Raises ``ValueError`` when there are no pairs."""
    if not pairs:
        raise ValueError("expected at least one pair")
    n = len(pairs)
    given = [(pair, a) for pair, a in zip(pairs, answers, strict=True) if not isinstance(a, NoMatch)]
    errors = np.array([error(pair, a) for pair, a in given]).reshape(-1, 3)
    good = within_limits(errors)
    nees = np.array([normalised(e, p, a) for e, (p, a) in zip(errors, given, strict=True)])
    claimed = not np.any(np.isnan(nees))
    low, high = wilson(int(good.sum()), n)
    return Score(
        pairs=n,
        success=float(good.sum()) / n,
        success_low=low,
        success_high=high,
        silent=float(np.sum(~good & (nees > COVERED))) / n if claimed else None,
        no_match=1.0 - len(given) / n,
        anees=_or_none(np.mean, nees / 3.0) if claimed else None,
        anees_median=_or_none(np.median, nees / CHI2_MEDIAN) if claimed else None,
        rms_m=_or_none(_rms, np.hypot(errors[good, 0], errors[good, 1])),
        rms_rad=_or_none(_rms, errors[good, 2]),
        ms=1e3 * float(np.median(seconds)),
        ms_95=1e3 * float(np.percentile(seconds, 95.0)),
    )


def error(pair: Pair, answer: Answer | Match) -> Array:
    """ξ ``(3,)`` with T_true = T̂ ∘ exp(ξ): the tangent space a match's covariance is in."""
    return se2.log(se2.between(answer.T_reference_scan, pair.T_reference_scan))


def within_limits(errors: Array) -> np.ndarray:
    """Which of the errors ``(N, 3)`` are successes."""
    distance, angle = LIMIT
    return (np.hypot(errors[:, 0], errors[:, 1]) <= distance) & (np.abs(errors[:, 2]) <= angle)


def normalised(xi: Array, pair: Pair, answer: Answer | Match) -> float:
    """ξᵀ(Σ + Σ_truth)⁻¹ξ: the squared error in standard deviations; NaN where no covariance is claimed."""
    if answer.covariance is None:
        return float("nan")
    claimed = answer.covariance + pair.truth_covariance + SINGULAR * np.eye(3)
    return float(xi @ np.linalg.pinv(claimed, hermitian=True) @ xi)


def wilson(successes: int, count: int) -> tuple[float, float]:
    """Wilson's interval at 95 % for a share of ``successes`` in ``count`` (Wilson 1927)."""
    z = NormalDist().inv_cdf(0.5 + 0.5 * CONFIDENCE)
    share, spread = successes / count, z * z / count
    centre = (share + 0.5 * spread) / (1.0 + spread)
    half = math.sqrt(share * (1.0 - share) * spread + 0.25 * spread * spread) / (1.0 + spread)
    return max(centre - half, 0.0), min(centre + half, 1.0)


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _or_none(statistic: Callable[[Array], object], values: Array) -> float | None:
    return float(statistic(values)) if len(values) else None  # type: ignore[arg-type]
