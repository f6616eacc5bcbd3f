import numpy as np
import pytest

from scenarios.evaluation.consistency import consistency_metrics, squared_errors
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
    (honest,) = consistency_metrics("x", moved, covariance, truth)
    (bold,) = consistency_metrics("x", moved, covariance / 4, truth)
    assert honest.value == pytest.approx(1.0, abs=0.05)  # sd of the mean: sqrt(2 / (3 n)) = 0.013
    assert bold.value == pytest.approx(4 * honest.value)
    assert honest.better is None


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
    (metric,) = consistency_metrics("x", np.zeros((2, 3)), covariance, truth)
    assert metric.reason == reason
