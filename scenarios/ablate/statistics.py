"""Intervals and paired tests of the studies: scipy.stats, and what is left out of it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Self

import numpy as np
from scipy.stats import binomtest, bootstrap, wilcoxon

from slam.se2 import Array
from slam.table import with_interval

RESAMPLES = 4000
"""Bootstrap resamples of an interval (percentiles, Efron 1979)."""
LEVEL = 0.05
"""Accepted chance of an error, over all comparisons of one family together."""
NAN = float("nan")


@dataclass(frozen=True)
class Mean:
    """A mean over ``n`` drives and its 95 % interval; NaN without a drive."""

    mean: float
    low: float
    high: float
    n: int

    def map(self, function: Callable[[float], float]) -> Mean:
        """The same on another scale; ``function`` is increasing."""
        mean, low, high = (float(function(value)) for value in (self.mean, self.low, self.high))
        return Mean(mean, low, high, self.n)

    def text(self, decimals: int) -> str:
        """The mean with its interval in brackets."""
        return with_interval(self.mean, self.low, self.high, decimals)


@dataclass(frozen=True)
class Proportion:
    """``count`` of some, as a ``share`` with its 95 % interval (Wilson 1927)."""

    count: int
    share: float
    interval: tuple[float, float]

    @classmethod
    def of(cls, count: int, n: int) -> Self:
        """``count`` of ``n``; of nothing the share is NaN, and anywhere from 0 to 1."""
        if n == 0:
            return cls(count, NAN, (0.0, 1.0))
        limits = binomtest(count, n).proportion_ci(method="wilson")
        return cls(count, count / n, (float(limits.low), float(limits.high)))

    def __str__(self) -> str:
        return with_interval(self.share, *self.interval)


@dataclass(frozen=True)
class PairedDifference:
    """How much larger ``first`` is than ``second``: mean of the paired differences with its 95 % interval,
    p of Wilcoxon's signed-rank test, and p after Holm's correction."""

    first: str
    second: str
    difference: Mean
    p: float
    p_holm: float

    @property
    def significant(self) -> bool:
        """Whether the page may say so: the corrected test and the interval agree."""
        return self.p_holm < LEVEL and (self.difference.low > 0.0 or self.difference.high < 0.0)

    def swapped(self) -> PairedDifference:
        """How much larger ``second`` is than ``first``."""
        d = self.difference
        return PairedDifference(
            self.second, self.first, Mean(-d.mean, -d.high, -d.low, d.n), self.p, self.p_holm
        )


def mean_interval(values: Array, strata: Sequence[str], rng: np.random.Generator) -> Mean:
    """Mean of ``values (n,)`` with its bootstrap interval, each of the ``strata (n,)`` resampled by itself.

    NaN are left out. Where every stratum has one value there is nothing to resample: the interval is NaN.
    """
    there = np.isfinite(values)
    n, names = int(there.sum()), np.asarray(strata)[there]
    if n == 0:
        return Mean(NAN, NAN, NAN, 0)
    groups = [values[there][names == name] for name in np.unique(names)]
    several = [group for group in groups if len(group) > 1]
    value, fixed = float(values[there].mean()), sum(float(group[0]) for group in groups if len(group) == 1)
    if not several:
        return Mean(value, NAN, NAN, n)

    def mean(*samples: Array, axis: int) -> Array:
        return (sum(sample.sum(axis=axis) for sample in samples) + fixed) / n

    return Mean(value, *_limits(several, mean, rng), n)


def median_interval(values: Array, rng: np.random.Generator) -> tuple[float, float]:
    """95 % bootstrap interval of the median of ``values (n,)``; NaN of a single one."""
    return _limits([values], np.median, rng) if len(values) > 1 else (NAN, NAN)


def _limits(
    samples: Sequence[Array], statistic: Callable[..., Array], rng: np.random.Generator
) -> tuple[float, float]:
    result = bootstrap(
        samples, statistic, n_resamples=RESAMPLES, vectorized=True, method="percentile", random_state=rng
    )
    return float(result.confidence_interval.low), float(result.confidence_interval.high)


def compare_pairs(
    table: Mapping[str, Array], strata: Sequence[str], rng: np.random.Generator
) -> list[PairedDifference]:
    """All pairs of ``table``, name -> values ``(n,)`` of the same drives, one family of Holm (1979)."""
    compared = []
    for first, second in combinations(table, 2):
        differences = table[first] - table[second]
        compared.append((first, second, mean_interval(differences, strata, rng), signed_rank_p(differences)))
    adjusted = holm([p for *_, p in compared])
    return [PairedDifference(*one, q) for one, q in zip(compared, adjusted, strict=True)]


def signed_rank_p(differences: Array) -> float:
    """Two-sided p of Wilcoxon's signed-rank test of ``differences (n,)`` but NaN; 1 where all are zero."""
    different = differences[np.isfinite(differences) & (differences != 0.0)]
    return float(wilcoxon(different).pvalue) if len(different) else 1.0


def holm(p: Sequence[float]) -> list[float]:
    """p-values corrected for being many (Holm 1979), in their order."""
    order = np.argsort(p, kind="stable")
    adjusted = np.empty(len(p))
    factors = len(p) - np.arange(len(p))
    adjusted[order] = np.minimum(np.maximum.accumulate(factors * np.asarray(p, dtype=np.float64)[order]), 1.0)
    return adjusted.tolist()
