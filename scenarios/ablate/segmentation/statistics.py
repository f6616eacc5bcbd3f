"""Means over drives with intervals, and paired comparisons that are told apart from chance."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from slam.se2 import Array

DRAWS, FLIPS = 2000, 20000
"""Resamples of an interval, and random signs of a test."""
LEVEL = 0.05
"""Chance of an error that is accepted, over all comparisons of one family together."""


@dataclass(frozen=True)
class Mean:
    """A mean over ``n`` drives and its 95 % interval; NaN without a drive."""

    value: float
    low: float
    high: float
    n: int


@dataclass(frozen=True)
class Comparison:
    """How much larger ``first`` is than ``second``: mean of the paired differences with its 95 % interval,
    the chance of one as large were they alike, and that after Holm's correction."""

    first: str
    second: str
    difference: Mean
    p: float
    adjusted: float

    @property
    def significant(self) -> bool:
        """Whether the page may say so: the corrected test and the interval agree."""
        low, high = self.difference.low, self.difference.high
        return self.adjusted < LEVEL and (low > 0.0 or high < 0.0)


def resamples(strata: Sequence[str], rng: np.random.Generator) -> np.ndarray:
    """Indices ``(DRAWS, n)`` of drives drawn with replacement, each ``strata (n,)`` by itself."""
    groups = np.asarray(strata)
    drawn = np.empty((DRAWS, len(groups)), dtype=np.int64)
    for name in np.unique(groups):
        rows = np.flatnonzero(groups == name)
        drawn[:, rows] = rows[rng.integers(len(rows), size=(DRAWS, len(rows)))]
    return drawn


def mean(values: Array, drawn: np.ndarray) -> Mean:
    """Mean of ``values (n,)`` and the percentile interval of its resamples; NaN are left out.

    A drive of each kind leaves nothing to draw: the interval is NaN.
    """
    there = np.isfinite(values)
    if not there.any():
        return Mean(np.nan, np.nan, np.nan, 0)
    if (drawn == drawn[0]).all():
        return Mean(float(values[there].mean()), np.nan, np.nan, int(there.sum()))
    counts = there[drawn].sum(axis=1)
    sums = np.where(there, values, 0.0)[drawn].sum(axis=1)
    low, high = np.percentile(sums[counts > 0] / counts[counts > 0], [2.5, 97.5])
    return Mean(float(values[there].mean()), float(low), float(high), int(there.sum()))


def comparisons(
    table: Mapping[str, Array], drawn: np.ndarray, rng: np.random.Generator, among: Sequence[str] = ()
) -> list[Comparison]:
    """All pairs of ``table``, name -> values ``(n,)`` of the same drives, as one family.

    With ``among``, only pairs with one of these. The test flips the signs of the differences at random
    (Fisher); corrected by Holm (1979).
    """
    pairs = [pair for pair in combinations(table, 2) if not among or set(pair) & set(among)]
    found = []
    for first, second in pairs:
        differences = table[first] - table[second]
        found.append((first, second, mean(differences, drawn), flipped(differences, rng)))
    adjusted = holm([p for *_, p in found])
    return [Comparison(*one, q) for one, q in zip(found, adjusted, strict=True)]


def flipped(differences: Array, rng: np.random.Generator) -> float:
    """Two-sided p of the mean of paired ``differences (n,)`` were their signs random; 1 without any."""
    there = differences[np.isfinite(differences)]
    if len(there) == 0:
        return 1.0
    signs = rng.integers(0, 2, size=(FLIPS, len(there)), dtype=np.int8) * 2.0 - 1.0
    observed = abs(there.sum())
    return float((1 + np.sum(np.abs(signs @ there) >= observed * (1.0 - 1e-12))) / (FLIPS + 1))


def holm(p: Sequence[float]) -> list[float]:
    """p-values corrected for being many (Holm 1979), in their order."""
    order = np.argsort(p, kind="stable")
    adjusted = np.empty(len(p))
    worst = 0.0
    for rank, k in enumerate(order):
        worst = max(worst, min(1.0, (len(p) - rank) * p[k]))
        adjusted[k] = worst
    return adjusted.tolist()
