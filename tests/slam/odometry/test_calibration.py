"""What matched steps teach about an inertial sensor."""

from __future__ import annotations

import numpy as np
import pytest

from slam import se2
from slam.odometry.calibration import Calibration

SIGMA = np.array([0.003, 0.003, 0.001])


def taught(scale: float, bias: float, heading: float, steps: int = 400, shock: float = 0.0) -> Calibration:
    """A calibration after steps of a sensor whose yaw reads (true − bias·dt) / scale, in a turned world."""
    rng = np.random.default_rng(0)
    calibration = Calibration()
    for k in range(steps):
        turn, seconds = rng.uniform(-0.2, 0.2), 0.2
        true = np.array([*(se2.rotation(rng.uniform(-3.0, 3.0)) @ [0.2, 0.0]), turn])
        sensed = np.append(se2.rotation(-heading) @ true[:2], (turn - bias * seconds) / scale)
        sensed += rng.normal(0.0, [0.002, 0.002, 0.001])
        sensed[2] += shock if k % 7 == 0 else 0.0
        calibration.learn(sensed, seconds, true, SIGMA)
    return calibration


@pytest.mark.parametrize(
    ("scale", "bias", "heading"), [(1.0, 0.0, 0.0), (1.05, 0.004, 0.1), (0.96, -0.003, -0.2)]
)
def test_scale_bias_and_heading_are_learnt(scale: float, bias: float, heading: float) -> None:
    calibration = taught(scale, bias, heading)
    np.testing.assert_array_less(np.abs(calibration.coefficients - [scale, bias]), [0.006, 0.0015])
    assert calibration.heading == pytest.approx(heading, abs=0.005)
    expected = np.append(se2.rotation(heading) @ [0.3, 0.1], scale * 0.1 + bias * 0.5)
    np.testing.assert_allclose(calibration.corrected(np.array([0.3, 0.1, 0.1]), 0.5), expected, atol=3e-3)


def test_shocks_teach_nothing() -> None:
    shocked = taught(1.03, 0.0, 0.0, shock=0.2)
    np.testing.assert_array_less(np.abs(shocked.coefficients - [1.03, 0.0]), [0.006, 0.0015])


def test_at_rest_nothing_is_learnt_about_the_heading() -> None:
    calibration = Calibration()
    for _ in range(100):
        calibration.learn(np.array([0.01, 0.0, 0.0]), 0.2, np.array([0.0, 0.01, 0.0]), SIGMA)
    assert calibration.heading == 0.0


def test_the_yaw_may_be_logged_on_either_side_of_pi() -> None:
    calibration = Calibration()
    turned = calibration.corrected(np.array([0.0, 0.0, 0.1 - 2.0 * np.pi]), 0.2)
    assert turned[2] == pytest.approx(0.1, abs=1e-9)


def test_one_wild_course_moves_the_heading_little() -> None:
    calibration = Calibration()
    calibration.learn(np.array([0.1, 0.0, 0.0]), 0.2, np.array([-0.1, 0.0, 0.0]), SIGMA)
    assert abs(calibration.heading) < 0.05
