"""The confidence table: every measure by hand, and what stands where there is nothing to measure."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from slam import se2
from slam.matching import Match
from slam.odometry import combination, confidence
from slam.odometry.confidence import FAILURE, MEASURES
from slam.odometry.match_statistics import MatchStatistics
from slam.se2 import Array

quick = settings(deadline=None, max_examples=50, derandomize=True)

P = np.array([[4.0, 1.0, 0.5], [1.0, 3.0, 0.2], [0.5, 0.2, 9.0]])
GOOD = np.diag([0.01, 0.02, 0.01]) ** 2


def found(
    covariance: Array = GOOD,
    matches: int = 150,
    rms: float = 1.0,
    p90: float = 0.05,
    misfit: float = 0.5,
    iterations: int = 5,
    weakest: float = 1e4,
) -> Match:
    """What a matcher answered."""
    eigenvalues = np.array([weakest, 2e4, 3e4])
    return Match(np.zeros(3), covariance, np.eye(3), matches, eigenvalues, rms, p90, misfit, iterations)


BAD = found(P, 8, 5.0, 0.4, 6.0, 60, 3.0)


def statistics(
    results: Sequence[Match | None],
    surprise: Sequence[Array] | None = None,
    tilts: Sequence[float] | None = None,
) -> MatchStatistics:
    """Of steps after a first scan that nothing was tried of; None is a match that failed."""
    noted = MatchStatistics.empty(len(results) + 1)
    for k, result in enumerate(results, start=1):
        if result is None:
            noted.note_failure(k)
            continue
        off = np.zeros(3) if surprise is None else surprise[k - 1]
        attitude = (0.0, 0.0) if tilts is None else (tilts[k - 1], 0.0)
        noted.note(k, result, 200, attitude, off, np.zeros(3), GOOD)
    return noted


def value(name: str, result: Match, **about: Sequence[float]) -> float:
    return float(MEASURES[name](statistics([result], **about))[1])  # type: ignore[arg-type]


def test_the_reports_measures_by_hand() -> None:
    one = found(P, 120)
    assert value("trace2", one) == 7.0
    assert value("det2", one) == 11.0
    assert value("neg_matches", one) == -120.0
    assert value("zero_match", one) == value("zero_run2", one) == 0.0


def test_the_report_takes_the_magnitude_of_what_is_indefinite() -> None:
    indefinite = np.array([[1.0, 2.0, 0.0], [2.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    assert value("det2", found(indefinite)) == 3.0
    assert value("trace2", found(-P)) == 7.0
    assert value("det2", found(-P)) == 11.0


def test_covariances_count_in_units_of_a_failure() -> None:
    sigma = np.array([2.0 * FAILURE[0], FAILURE[0], 3.0 * FAILURE[1]])
    one = found(np.diag(sigma**2))
    assert value("a_opt", one) == pytest.approx((4.0 + 1.0 + 9.0) / 3.0)
    assert value("d_opt", one) == pytest.approx(36.0 ** (1.0 / 3.0))
    assert value("e_opt", one) == pytest.approx(9.0)


def test_measures_of_the_residuals_and_the_search() -> None:
    one = found(matches=50, rms=1.5, p90=0.2, misfit=2.5, iterations=7, weakest=400.0)
    assert value("neg_match_share", one) == -0.25
    assert value("residual_rms", one) == 1.5
    assert value("residual_p90", one) == 0.2
    assert value("misfit", one) == 2.5
    assert value("iterations", one) == 7.0
    assert value("degeneracy", one) == -400.0


def test_tilt_is_the_angle_to_the_vertical() -> None:
    assert value("tilt", found(), tilts=[0.3]) == pytest.approx(0.3)
    roll, pitch = 0.3, -0.4
    noted = MatchStatistics.empty(1)
    noted.note(0, found(), 200, (roll, pitch), np.zeros(3), np.zeros(3), GOOD)
    up = np.array([np.cos(roll) * np.sin(pitch), -np.sin(roll), np.cos(roll) * np.cos(pitch)])
    assert confidence.tilt(noted)[0] == pytest.approx(np.arccos(up[2]))
    level = MatchStatistics.empty(1)
    level.note(0, found(), 200, None, np.zeros(3), np.zeros(3), GOOD)
    assert np.isnan(confidence.compute_measures(level)["tilt"][0])  # nothing to measure it by is not level


@given(st.lists(st.floats(-0.3, 0.3), min_size=3, max_size=3), st.integers(0, 1000))
@quick
def test_innovation_against_the_formula(step: list[float], seed: int) -> None:
    A = np.random.default_rng(seed).normal(size=(3, 3))
    covariance = 1e-3 * A @ A.T
    r = se2.log(np.array(step))
    expected = r @ np.linalg.inv(covariance + GOOD) @ r
    assert value("innovation", found(covariance), surprise=[step]) == pytest.approx(expected, rel=1e-6)


def test_an_innovation_is_seen_from_where_the_robot_was_expected() -> None:
    expected, step = np.array([3.0, -2.0, 1.2]), np.array([0.2, -0.1, 0.05])
    noted = MatchStatistics.empty(1)
    noted.note(0, found(), 200, None, se2.compose(expected, step), expected, GOOD)
    r = se2.log(step)
    turned = se2.to_body_covariance(expected, GOOD)
    assert confidence.innovation(noted)[0] == pytest.approx(r @ np.linalg.inv(GOOD + turned) @ r)


def test_what_is_negative_in_a_covariance_does_not_sharpen_an_innovation() -> None:
    step = [0.1, 0.1, 0.0]
    negative = value("innovation", found(-P), surprise=[step])
    assert negative == pytest.approx(value("innovation", found(0.0 * P), surprise=[step]))
    assert value("innovation", found(1e30 * P), surprise=[step]) >= 0.0


def test_a_failure_between_matches_is_forgiven_by_the_second_rule_only() -> None:
    good = found()
    column = confidence.compute_measures(statistics([good, None, good, None, None, good, None]))
    np.testing.assert_array_equal(column["zero_run2"][1:], [0, 1, 0, np.inf, np.inf, 0, 1])
    np.testing.assert_array_equal(column["zero_match"][1:], [0, np.inf, 0, np.inf, np.inf, 0, np.inf])


def test_scans_that_were_skipped_do_not_end_a_run() -> None:
    noted = MatchStatistics.empty(5)
    noted.note_failure(1)
    noted.note_failure(3)
    np.testing.assert_array_equal(
        confidence.compute_measures(noted)["zero_run2"], [np.nan, np.inf, np.nan, np.inf, np.nan]
    )


@pytest.mark.parametrize("name", sorted(set(MEASURES) - {"zero_match", "zero_run2"}))
def test_larger_is_worse(name: str) -> None:
    steps = statistics([found(), BAD], [np.zeros(3), np.array([0.5, 0.2, 0.3])], [0.0, 0.4])
    good, bad = MEASURES[name](steps)[1:]
    assert bad > good


@pytest.mark.parametrize("name", sorted(MEASURES))
def test_a_failed_match_is_worst_and_no_match_is_nothing(name: str) -> None:
    absurd = found(1e30 * P, 4)
    column = confidence.compute_measures(statistics([found(), None, None, absurd]))[name]
    assert column.shape == (5,)
    assert np.isnan(column[0])
    assert np.all(np.isfinite(column[[1, 4]]))
    assert np.all(column[[2, 3]] == np.inf)


@pytest.mark.parametrize("name", sorted(MEASURES))
def test_a_measure_says_what_it_is_and_is_blind_to_other_steps(name: str) -> None:
    assert MEASURES[name].__doc__
    if name == "zero_run2":  # it looks at its neighbours
        return
    steps = statistics([found(), None, BAD, found(2.0 * GOOD, 90)])
    whole = confidence.compute_measures(steps)[name]
    for k in range(5):
        np.testing.assert_array_equal(confidence.compute_measures(steps[k : k + 1])[name], whole[k : k + 1])


def test_the_table_has_a_column_per_measure() -> None:
    assert {"trace2", "det2", "neg_matches", "combined"} <= set(MEASURES)
    assert list(confidence.compute_measures(statistics([found()]))) == list(MEASURES)


def test_the_combination_by_hand() -> None:
    steps = statistics([BAD], [np.array([0.5, 0.2, 0.3])])
    expected = combination.BIAS
    for name, weight in combination.WEIGHTS.items():
        number = float(MEASURES[name](steps)[1])
        expected += weight * (np.log(number) if name in combination.LOGARITHMIC else number)
    assert float(confidence.combined(steps)[1]) == pytest.approx(expected)
    assert "combined" not in combination.WEIGHTS


def test_a_step_is_lost_beyond_either_limit() -> None:
    off = np.array([[0.16, 0.12, 0.0], [0.0, 0.0, -np.radians(5.0)], [0.1, 0.0, np.radians(10.0)]])
    np.testing.assert_allclose(confidence.step_error(off), [1.0, 1.0, 2.0])
    assert confidence.step_error(np.array([0.0, 0.0, 2.0 * np.pi])) == pytest.approx(0.0, abs=1e-12)
