"""What speaks for an alignment, and what against."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from stitch.raster import Raster
from stitch.result import Prior
from stitch.verification import (
    NOTHING,
    Acceptance,
    Evidence,
    Standing,
    far_from,
    measure,
    reason_against,
)

GOOD = Evidence(overlap_area=20.0, open_area=15.0, agreement=0.9)
LIMITS = Acceptance(min_odds=2.0, min_odds_guided=-1.0, min_firmness=0.1, min_lead=2.0, max_rivalry=0.3)


def raster(rows: list[str], first: tuple[int, int] = (0, 0), resolution: float = 1.0) -> Raster:
    """'#' occupied, '.' free, ' ' unknown; the first string is the lowest row."""
    cells = np.array([list(row) for row in rows])
    return Raster(cells == "#", cells == ".", np.array(first, dtype=float), resolution)


def test_by_hand() -> None:
    a = raster(["#....", "#....", "     "])
    b = raster(["#...#", "     ", "     "])
    evidence = measure(a, b)
    assert evidence.overlap_area == 5.0
    assert evidence.open_area == 3.0
    # b has two walls in the overlap: one shared, one in a's free space; a has two, both near a wall of b
    assert evidence.agreement == pytest.approx(0.5)


def test_offsets_and_resolution_count() -> None:
    a = raster(["....", "...."], (10, 5), 0.5)
    b = raster(["....", "...."], (12, 6), 0.5)
    assert measure(a, b).overlap_area == pytest.approx(2 * 0.25)
    assert measure(b, a) == measure(a, b)


def test_maps_apart_share_nothing() -> None:
    assert measure(raster(["#."]), raster(["#."], (5, 5))) == NOTHING


def test_rasters_of_different_resolution_are_refused() -> None:
    with pytest.raises(ValueError, match="resolution"):
        measure(raster(["#"]), raster(["#"], resolution=0.5))


STANDING = Standing(odds=30.0, rival=2.5, firmness=0.9, guided=False)


def test_good_evidence_is_believed() -> None:
    assert reason_against(GOOD, STANDING, LIMITS) is None
    assert reason_against(GOOD, STANDING, Acceptance()) is None


@pytest.mark.parametrize(
    ("change", "standing", "word"),
    [
        ({"overlap_area": 3.9}, {}, "overlap"),
        ({"open_area": 2.9}, {}, "free in both"),
        ({}, {"odds": 1.9, "rival": -np.inf}, "evidence"),
        ({}, {"odds": -1.1, "rival": -np.inf, "guided": True}, "evidence"),
        ({}, {"odds": np.nan}, "evidence"),
        ({}, {"firmness": 0.09}, "firmness"),
        ({}, {"odds": 3.5, "rival": 1.9}, "lead"),
        ({}, {"rival": 10.5}, "ambiguity"),
        ({}, {"rival": 31.0}, "ambiguity"),
        ({}, {"rival": np.nan}, "ambiguity"),
    ],
)
def test_every_limit_can_refuse(change: dict, standing: dict, word: str) -> None:
    reason = reason_against(replace(GOOD, **change), replace(STANDING, **standing), LIMITS)
    assert reason is not None
    assert word in reason
    assert "\n" not in reason


def test_a_prior_needs_less_evidence() -> None:
    weak = replace(STANDING, odds=0.5, rival=-np.inf)
    assert reason_against(GOOD, weak, LIMITS) is not None
    assert reason_against(GOOD, replace(weak, guided=True), LIMITS) is None


def test_rivalry_is_counted_from_the_least_odds() -> None:
    """2 is the least, so a rival at 5 has 3 of the 10 that the best has above it; beside a prior 6 of 13."""
    fair = replace(STANDING, odds=12.0)
    assert reason_against(GOOD, replace(fair, rival=4.9), LIMITS) is None
    reason = reason_against(GOOD, replace(fair, rival=5.1), LIMITS)
    assert reason is not None
    assert "odds of a rival) 0.31, expected at most 0.3" in reason
    guided = reason_against(GOOD, replace(fair, rival=5.0, guided=True), LIMITS)
    assert guided is not None
    assert "odds of a rival) 0.462" in guided


@pytest.mark.parametrize("rival", [-np.inf, -40.0, -1.0])
def test_a_rival_that_nobody_would_believe_is_none(rival: float) -> None:
    assert reason_against(GOOD, replace(STANDING, odds=3.0, rival=rival), LIMITS) is None


def test_far_from_the_prior() -> None:
    prior, sigma = Prior(np.zeros(3), np.diag([1.0, 1.0, 0.1]) ** 2), 1e-4 * np.eye(3)
    assert far_from(None, np.array([9.0, 0.0, 0.0]), sigma, Acceptance()) is None
    assert far_from(prior, np.array([4.0, 0.0, 0.0]), sigma, Acceptance()) is None
    reason = far_from(prior, np.array([4.1, 0.0, 0.0]), sigma, Acceptance())
    assert reason is not None
    assert "prior" in reason
