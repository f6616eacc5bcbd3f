import numpy as np
import pytest
from scipy.stats import norm

from scenarios.evaluation.trajectory import (
    CONSISTENCY,
    band,
    consistency_metrics,
    crps,
    last_squared_error,
    squared_errors,
)
from slam import se2

SIGMA = np.diag([0.04, 0.01, 0.0025])


def test_squared_error_by_hand():
    truth = np.array([[0.0, 0, 0], [1, 0, np.pi / 2]])
    estimate = np.array([[0.0, 0, 0], [1, -0.2, np.pi / 2]])  # 0.2 m behind, seen from the body
    covariance = np.stack([SIGMA, SIGMA])
    assert squared_errors(estimate, covariance, truth) == pytest.approx([0.2**2 / 0.04])


def test_honest_covariance_scores_one_in_any_frame():
    rng = np.random.default_rng(3)
    n = 4000
    estimate = np.column_stack([rng.uniform(-9, 9, (n, 2)), rng.uniform(-3, 3, n)])
    truth = se2.compose(estimate, se2.exp(rng.multivariate_normal(np.zeros(3), SIGMA, n)))
    truth[0] = estimate[0]
    moved = se2.compose([5.0, -7.0, 1.0], estimate)
    covariance = np.tile(SIGMA, (n, 1, 1))
    honest = consistency_metrics(moved, covariance, truth)["anees"]
    bold = consistency_metrics(moved, covariance / 4, truth)["anees"]
    assert honest == pytest.approx(1.0, abs=0.05)  # sd of the mean: sqrt(2 / (3 n)) = 0.013
    assert bold == pytest.approx(4 * honest)
    assert CONSISTENCY["anees"].better is None


def test_the_median_of_the_errors_is_that_of_chi_square_and_forgives_a_few():
    rng = np.random.default_rng(4)
    n = 4000
    truth = se2.exp(rng.multivariate_normal(np.zeros(3), SIGMA, n))
    truth[0] = 0.0
    truth[1:40] += [50.0, 0.0, 0.0]
    values = consistency_metrics(np.zeros((n, 3)), np.tile(SIGMA, (n, 1, 1)), truth)
    assert values["anees_k"] == pytest.approx(1.0, abs=0.1)
    assert values["anees"] > 100.0


def test_crps_is_the_integral_over_the_distribution():
    """CRPS = ∫ (F(x) − 1[x ≥ y])² dx, and the absolute error where no doubt is stated."""
    x = np.linspace(-5.0, 5.0, 200_001)
    distribution = norm.cdf(x, scale=0.3)
    expected = np.sum((distribution - (x >= 0.5)) ** 2) * (x[1] - x[0])
    assert crps(np.array([0.5]), np.array([0.3])) == pytest.approx([expected], abs=1e-4)
    assert crps(np.array([-0.5]), np.array([1e-9])) == pytest.approx([0.5], abs=1e-8)


def test_poses_without_covariance_are_left_out():
    truth = np.zeros((4, 3))
    estimate = truth.copy()
    estimate[2:, 0] = 0.2
    covariance = np.stack(
        [np.full((3, 3), np.nan), np.full((3, 3), np.nan), SIGMA, np.diag([1.0, 1.0, -1.0])]
    )
    assert squared_errors(estimate, covariance, truth) == pytest.approx([1.0])


@pytest.mark.parametrize(
    ("covariance", "truth", "reason"),
    [
        (None, np.zeros((2, 3)), "the method states no covariance of its poses"),
        (np.zeros((2, 3, 3)), None, "the recording has no truth"),
        (np.zeros((2, 3, 3)), np.zeros((2, 3)), "no pose has a usable covariance"),
    ],
)
def test_what_is_missing_is_a_reason(covariance, truth, reason):
    assert consistency_metrics(np.zeros((2, 3)), covariance, truth) == dict.fromkeys(CONSISTENCY, reason)


@pytest.mark.parametrize(
    ("runs", "low", "high"),
    [(1, 0.2158 / 3, 9.3484 / 3), (10, 16.7908 / 30, 46.9792 / 30), (20, 40.4817 / 60, 83.2977 / 60)],
)
def test_bands_are_those_of_the_tables(runs, low, high):
    """Quantiles of χ² with 3, 30 and 60 degrees of freedom, as printed in any statistics book."""
    assert band(runs) == pytest.approx((low, high), rel=1e-4)


def test_bands_hold_what_they_promise():
    nees = np.random.default_rng(1).chisquare(3, (4000, 5)).mean(axis=1) / 3
    low, high = band(5, 0.9)
    assert np.mean((low < nees) & (nees < high)) == pytest.approx(0.9, abs=0.02)


def test_no_runs_have_no_band():
    with pytest.raises(ValueError, match="one run or more"):
        band(0)


def test_the_last_pose_by_hand():
    """The poses between do not matter: the last is 0.2 m behind and 0.1 rad off."""
    truth = np.array([[5.0, 0, 0], [6, 0, 0], [7, 0, 0.1]])
    estimate = np.array([[0.0, 0, 0], [9, 9, 9], [1.8, 0, 0]])
    covariance = np.stack([SIGMA] * 3)
    error = se2.log(se2.between(estimate[2], [2.0, 0, 0.1]))
    expected = error @ np.linalg.solve(SIGMA, error)
    assert last_squared_error(estimate, covariance, truth) == pytest.approx(expected)
    assert expected == pytest.approx(0.2**2 / 0.04 + 0.1**2 / 0.0025, rel=0.02)
    assert np.isnan(last_squared_error(estimate, None, truth))
    assert np.isnan(last_squared_error(estimate, covariance * np.nan, truth))
