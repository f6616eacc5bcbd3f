"""Whether one submission is surely better than another: paired tests over the recordings (Demšar 2006)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from scipy.stats import friedmanchisquare, rankdata, wilcoxon

SURE = 0.05


@dataclass(frozen=True)
class Comparison:
    """Submission ``a`` against ``b`` by their indices: on how many recordings a is better, and on how many b,
    which are no more; and the p-value of Wilcoxon's signed-rank test, after Holm's correction for all
    pairs."""

    a: int
    b: int
    wins: int
    losses: int
    p: float


def mean_ranks(errors: Sequence[Sequence[float]]) -> list[float]:
    """Mean rank of each submission over the recordings, 1 the best, of ``errors`` by submission and
    recording; a failure is an infinite error, so it is last, and failures share their rank."""
    if not errors or not errors[0]:
        return [math.nan] * len(errors)
    ranks = rankdata(np.asarray(errors, dtype=float), axis=0)
    return [float(rank) for rank in ranks.mean(axis=1)]


def friedman(errors: Sequence[Sequence[float]]) -> float | None:
    """p-value of Friedman's test that all submissions are alike; None for fewer than three submissions or
    recordings."""
    if len(errors) < 3 or len(errors[0]) < 3:
        return None
    p = float(friedmanchisquare(*_finite(errors)).pvalue)
    return p if math.isfinite(p) else None  # all are ties


def compare(errors: Sequence[Sequence[float]]) -> list[Comparison]:
    """Every pair of submissions; p-values are corrected (Holm 1979), the smallest first."""
    pairs = [_pair(errors, a, b) for a, b in combinations(range(len(errors)), 2)]
    pairs.sort(key=lambda pair: pair.p)
    corrected, largest = [], 0.0
    for k, pair in enumerate(pairs):
        largest = max(largest, min(1.0, (len(pairs) - k) * pair.p))
        corrected.append(replace(pair, p=largest))
    return corrected


def _pair(errors: Sequence[Sequence[float]], a: int, b: int) -> Comparison:
    one, other = _finite([errors[a], errors[b]])
    difference = one - other
    p = float(wilcoxon(difference, zero_method="zsplit").pvalue) if np.any(difference) else 1.0
    wins, losses = int(np.sum(difference < 0)), int(np.sum(difference > 0))
    return Comparison(a, b, wins, losses, p) if wins >= losses else Comparison(b, a, losses, wins, p)


def _finite(errors: Sequence[Sequence[float]]) -> np.ndarray:
    """The errors, where failures are larger than all else by far: the tests are of ranks."""
    found = np.asarray(errors, dtype=float)
    known = found[np.isfinite(found)]
    return np.where(np.isfinite(found), found, 1.0 + 10.0 * known.max(initial=0.0))
