"""How well lost steps are found: by hand, and against slow twins, ties and +inf included."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from scenarios.evaluation.detection import (
    Decision,
    average_precision,
    best_threshold,
    decided,
    precision_recall,
    roc_auc,
    spearman,
)

quick = settings(deadline=None, max_examples=150, derandomize=True)
INF, NAN = np.inf, np.nan

STEPS = st.lists(
    st.tuples(st.sampled_from([-2.0, 0.0, 1.0, 1.5, 1e30, INF]), st.booleans()), min_size=2, max_size=25
)


def scores(*values: float) -> np.ndarray:
    return np.array(values, dtype=float)


def lost(*values: int) -> np.ndarray:
    return np.array(values, dtype=bool)


def test_auc_by_hand() -> None:
    # Of 2 × 3 pairs: 3 > all three, 1 > 0, ties with 1, loses to 2.
    assert roc_auc(scores(3, 1, 2, 1, 0), lost(1, 1, 0, 0, 0)) == pytest.approx((3 + 1 + 0.5) / 6)
    assert roc_auc(scores(INF, INF, 0), lost(1, 0, 0)) == pytest.approx(0.75)
    assert roc_auc(scores(1, 1, 1), lost(1, 0, 1)) == 0.5
    assert np.isnan(roc_auc(scores(1, 2), lost(1, 1)))


def test_average_precision_by_hand() -> None:
    # Down the ranking: lost, not, lost: precision 1 at half the recall, 2/3 at the rest.
    assert average_precision(scores(3, 2, 1), lost(1, 0, 1)) == pytest.approx(0.5 + 0.5 * 2 / 3)
    # Ties are called together, whatever their order.
    for order in ([0, 1, 2, 3], [1, 0, 3, 2]):
        found = average_precision(scores(INF, INF, 0, 0)[order], lost(1, 0, 1, 0)[order])
        assert found == pytest.approx(0.5)
    # Who knows nothing has the base rate.
    assert average_precision(np.zeros(10), np.arange(10) < 3) == pytest.approx(0.3)
    assert np.isnan(average_precision(scores(1, 2), lost(0, 0)))


def test_the_curve_by_hand() -> None:
    precision, recall, thresholds = precision_recall(scores(INF, 2, 2, 1), lost(0, 1, 1, 0))
    np.testing.assert_allclose(precision, [0.0, 2 / 3, 0.5])
    np.testing.assert_allclose(recall, [0.0, 1.0, 1.0])
    np.testing.assert_array_equal(thresholds, [INF, 2.0, 1.0])


@given(STEPS)
@quick
def test_auc_against_all_pairs(steps: list[tuple[float, bool]]) -> None:
    values, truth = map(np.array, zip(*steps, strict=True))
    pairs = [1.0 if a > b else 0.5 if a == b else 0.0 for a in values[truth] for b in values[~truth]]
    found = roc_auc(values, truth)
    assert np.isnan(found) if not pairs else found == pytest.approx(np.mean(pairs))


@given(STEPS)
@quick
def test_average_precision_against_every_threshold(steps: list[tuple[float, bool]]) -> None:
    values, truth = map(np.array, zip(*steps, strict=True))
    if not truth.any():
        return
    total, before = 0.0, 0.0
    for threshold in sorted(set(values.tolist()), reverse=True):
        called = decided(values >= threshold, truth)
        total += (called.recall - before) * called.precision
        before = called.recall
    assert average_precision(values, truth) == pytest.approx(total)


@given(STEPS)
@quick
def test_the_best_threshold_against_every_threshold(steps: list[tuple[float, bool]]) -> None:
    values, truth = map(np.array, zip(*steps, strict=True))
    if not truth.any():
        return
    failed = np.isposinf(values)

    def f1(threshold: float) -> float:
        made = decided(failed | (values > threshold), truth)
        return 0.0 if np.isnan(made.f1) else made.f1

    best = max(f1(threshold) for threshold in [INF, -INF, *values[~failed]])
    assert f1(best_threshold(values, truth, np.ones(len(values)))) == pytest.approx(best)


def test_weights_count_as_repetition() -> None:
    rng = np.random.default_rng(0)
    values, truth, times = rng.normal(size=40), rng.random(40) < 0.3, rng.integers(1, 5, 40)
    repeated = best_threshold(np.repeat(values, times), np.repeat(truth, times), np.ones(times.sum()))
    assert best_threshold(values, truth, times.astype(float)) == repeated


def test_spearman_by_hand() -> None:
    assert spearman(scores(1, 2, 3, INF), scores(-5, 0, 1e9, INF)) == pytest.approx(1.0)
    assert spearman(scores(1, 2, 3), scores(3, 2, 1)) == pytest.approx(-1.0)
    # Ranks 1, 2, 3.5, 3.5 and 2, 1, 3, 4.
    a, b = np.array([1, 2, 3.5, 3.5]), np.array([2, 1, 3, 4])
    expected = np.sum((a - 2.5) * (b - 2.5)) / np.sqrt(np.sum((a - 2.5) ** 2) * np.sum((b - 2.5) ** 2))
    assert spearman(scores(0, 1, INF, INF), scores(5, 4, 6, 7)) == pytest.approx(expected)
    assert np.isnan(spearman(scores(1, 1), scores(1, 2)))


def test_decisions_by_hand() -> None:
    made = decided(lost(1, 1, 0, 0), lost(1, 0, 1, 0))
    assert made == Decision(right=1, wrong=1, missed=1)
    assert (made.precision, made.recall, made.f1) == (0.5, 0.5, 0.5)
    both = made + Decision(3, 0, 0)
    assert (both.precision, both.recall, both.f1) == (0.8, 0.8, 0.8)
    assert np.isnan(Decision(0, 0, 2).precision)
    assert np.isnan(Decision(0, 0, 0).f1)


def test_what_is_no_number_is_refused() -> None:
    for function in (roc_auc, average_precision, precision_recall):
        with pytest.raises(ValueError, match="NaN"):
            function(scores(1, NAN), lost(1, 0))
    with pytest.raises(ValueError, match="one shape"):
        roc_auc(scores(1, 2, 3), lost(1, 0))
    with pytest.raises(ValueError, match="lost step"):
        best_threshold(scores(1, 2), lost(0, 0), np.ones(2))
