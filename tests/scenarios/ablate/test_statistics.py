"""The studies' statistics: by hand, and as often right as they say."""

from __future__ import annotations

import numpy as np
import pytest

from scenarios.ablate.statistics import (
    Proportion,
    compare_pairs,
    holm,
    mean_interval,
    median_interval,
    signed_rank_p,
)

NAN = np.nan


def test_wilson_interval() -> None:
    assert Proportion.of(9, 10).interval == pytest.approx((0.5958, 0.9821), abs=1e-3)  # Brown et al. 2001
    assert Proportion.of(0, 10).interval[0] == 0.0
    assert Proportion.of(10, 10).interval[1] == 1.0
    assert Proportion.of(0, 0).interval == (0.0, 1.0)


def test_holm_by_hand() -> None:
    assert holm([0.01, 0.04, 0.03, 0.005]) == pytest.approx([0.03, 0.06, 0.06, 0.02])
    assert holm([0.9, 0.8]) == [1.0, 1.0]
    assert holm([]) == []


def test_signed_ranks_by_hand() -> None:
    assert signed_rank_p(np.array([1.0, 2.0, 3.0, NAN])) == pytest.approx(0.25)  # two of eight signs
    assert signed_rank_p(np.array([1.0, -1.0])) == pytest.approx(1.0)
    assert signed_rank_p(np.array([0.0, NAN])) == 1.0
    assert signed_rank_p(np.arange(1.0, 31.0)) < 1e-6


def test_the_interval_of_a_median_holds_it_as_often_as_it_says() -> None:
    rng = np.random.default_rng(2)
    samples = rng.normal(1.0, 0.3, (300, 21))
    held = [low <= 1.0 <= high for low, high in (median_interval(sample, rng) for sample in samples)]
    assert 0.90 < np.mean(held) < 0.99
    twice = [median_interval(samples[0], np.random.default_rng(5)) for _ in range(2)]
    assert twice[0] == twice[1]
    assert np.isnan(median_interval(samples[0][:1], rng)).all()


def test_the_interval_of_a_mean_has_the_size_that_theory_says() -> None:
    rng = np.random.default_rng(1)
    values = rng.normal(3.0, 1.0, 100)
    values[:3] = NAN
    mean = mean_interval(values, ["a"] * 100, rng)
    spread = np.nanstd(values) / np.sqrt(97)
    assert mean.n == 97
    assert mean.mean == pytest.approx(np.nanmean(values))
    assert mean.low == pytest.approx(mean.mean - 1.96 * spread, abs=0.03)
    assert mean.high == pytest.approx(mean.mean + 1.96 * spread, abs=0.03)
    assert mean_interval(np.full(3, NAN), ["a"] * 3, rng).n == 0


def test_every_stratum_is_resampled_by_itself() -> None:
    """Scenarios that differ, each alike in itself, leave nothing to chance; nor does a drive of each."""
    rng = np.random.default_rng(0)
    mean = mean_interval(np.array([1.0, 5.0, 1.0, 5.0, 9.0]), ["a", "b", "a", "b", "c"], rng)
    assert (mean.low, mean.high) == pytest.approx((4.2, 4.2))
    assert np.isnan(mean_interval(np.array([1.0, 2.0]), ["a", "b"], rng).low)


def test_alike_measures_are_seldom_told_apart_and_others_are() -> None:
    rng = np.random.default_rng(2)
    strata, false = ["a"] * 20, 0
    for _ in range(8):
        table = {name: rng.normal(size=20) for name in "abcd"}
        false += any(one.significant for one in compare_pairs(table, strata, rng))
    assert false <= 2
    base = rng.normal(size=20)
    table = {"low": base, "high": base + 1.0 + 0.1 * rng.normal(size=20), "same": base + rng.normal(size=20)}
    compared = compare_pairs(table, strata, rng)
    assert [one.significant for one in compared] == [True, False, True]
    turned = compared[0].swapped()
    assert (turned.first, turned.second) == ("high", "low")
    assert 0.9 < turned.difference.low < turned.difference.mean < turned.difference.high
