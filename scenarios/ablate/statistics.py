"""Intervals and paired tests of the studies: scipy.stats, and what is left out of it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from scipy.stats import binomtest, bootstrap, wilcoxon

from slam.se2 import Array

RESAMPLES = 4000
"""Bootstrap resamples of an interval (percentiles, Efron 1979)."""
LEVEL = 0.05
"""Accepted chance of an error, over all comparisons of one family together."""
NAN = float("nan")


@dataclass(frozen=True)
class Mean:
    """A mean over ``n`` drives and its 95 % interval; NaN without a drive."""

    value: float
    low: float
    high: float
    n: int


@dataclass(frozen=True)
class Proportion:
    """``count`` of ``n``, and its 95 % interval (Wilson 1927)."""

    count: int
    n: int

    @property
    def value(self) -> float:
        """The share itself; NaN of nothing."""
        return self.count / self.n if self.n else NAN

    @property
    def interval(self) -> tuple[float, float]:
        """Lower and upper limit; 0 and 1 of nothing."""
        if self.n == 0:
            return 0.0, 1.0
        limits = binomtest(self.count, self.n).proportion_ci(method="wilson")
        return float(limits.low), float(limits.high)


@dataclass(frozen=True)
class PairedDifference:
    """How much larger ``first`` is than ``second``: mean of the paired differences with its 95 % interval,
    p of Wilcoxon's signed-rank test, and p after Holm's correction."""

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

    def swapped(self) -> PairedDifference:
        """How much larger ``second`` is than ``first``."""
        d = self.difference
        turned = Mean(-d.value, -d.high, -d.low, d.n)
        return PairedDifference(self.second, self.first, turned, self.p, self.adjusted)


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
    """All pairs of ``table``, name -> values ``(n,)`` of the same drives, as one family.

    Corrected by Holm (1979). ``strata (n,)`` as in `mean_interval`.
    """
    compared = []
    for first, second in combinations(table, 2):
        differences = table[first] - table[second]
        compared.append((first, second, mean_interval(differences, strata, rng), signed_rank_p(differences)))
    adjusted = holm([p for *_, p in compared])
    return [PairedDifference(*one, q) for one, q in zip(compared, adjusted, strict=True)]


def signed_rank_p(differences: Array) -> float:
    """Two-sided p of paired ``differences (n,)`` by Wilcoxon's signed-rank test; 1 where none is other than
    zero. NaN are left out."""
    different = differences[np.isfinite(differences) & (differences != 0.0)]
    return float(wilcoxon(different).pvalue) if len(different) else 1.0


def holm(p: Sequence[float]) -> list[float]:
    """p-values corrected for being many (Holm 1979), in their order."""
    order = np.argsort(p, kind="stable")
    adjusted = np.empty(len(p))
    factors = len(p) - np.arange(len(p))
    adjusted[order] = np.minimum(np.maximum.accumulate(factors * np.asarray(p, dtype=np.float64)[order]), 1.0)
    return adjusted.tolist()
