"""The confidence table: the report's measures, and what stands where there is nothing to measure."""

from __future__ import annotations

import numpy as np
import pytest

from slam import confidence
from slam.confidence import MEASURES, Evidence
from slam.se2 import Array


def evidence(covariances: list[Array], matches: list[int]) -> Evidence:
    n = len(matches)
    return Evidence(np.array(covariances), np.array(matches), np.ones(n, dtype=bool), np.zeros(n, dtype=bool))


P = np.array([[4.0, 1.0, 0.5], [1.0, 3.0, 0.2], [0.5, 0.2, 9.0]])


def test_known_answers() -> None:
    one = evidence([P], [120])
    assert confidence.trace2(one) == [7.0]
    assert confidence.det2(one) == [11.0]
    assert confidence.neg_matches(one) == [-120.0]


def test_the_report_takes_the_magnitude_of_what_is_indefinite() -> None:
    indefinite = evidence([np.array([[1.0, 2.0, 0.0], [2.0, 1.0, 0.0], [0.0, 0.0, 1.0]]), -P], [5, 5])
    np.testing.assert_array_equal(confidence.det2(indefinite), [3.0, 11.0])
    np.testing.assert_array_equal(confidence.trace2(indefinite), [2.0, 7.0])


@pytest.mark.parametrize("name", sorted(MEASURES))
def test_larger_is_worse(name: str) -> None:
    good, bad = MEASURES[name](evidence([1e-4 * P, P], [150, 10]))
    assert bad > good


@pytest.mark.parametrize("name", sorted(MEASURES))
def test_a_failed_match_is_worst_and_no_match_is_nothing(name: str) -> None:
    nothing = np.full((3, 3), np.nan)
    column = confidence.columns(
        Evidence(
            covariance=np.array([nothing, P, nothing, 1e30 * P]),
            matches=np.array([0, 100, 0, 4]),
            tried=np.array([False, True, True, True]),
            failed=np.array([False, False, True, False]),
        )
    )[name]
    assert np.isnan(column[0])
    assert column[2] == np.inf
    assert np.all(np.isfinite(column[[1, 3]]))
    assert column[2] > column[3] > column[1]


def test_the_table_has_a_column_per_measure() -> None:
    assert {"trace2", "det2", "neg_matches"} <= set(MEASURES)
    assert list(confidence.columns(evidence([P], [1]))) == list(MEASURES)
