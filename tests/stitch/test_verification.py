"""What speaks for an alignment, and what against."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from stitch.raster import Raster
from stitch.result import Prior
from stitch.verification import (
    Acceptance,
    Evidence,
    Standing,
    far_from,
    measure,
    odds,
    reason_against,
    rivalry,
)

GOOD = Evidence(overlap_area=20.0, open_area=15.0, omega=0.99, agreement=0.9, conflict=0.01)


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
    assert evidence.conflict == pytest.approx(1.0 / 4.0)
    assert evidence.omega == pytest.approx(4.0 / 5.0)


def test_offsets_and_resolution_count() -> None:
    a = raster(["....", "...."], (10, 5), 0.5)
    b = raster(["....", "...."], (12, 6), 0.5)
    assert measure(a, b).overlap_area == pytest.approx(2 * 0.25)
    assert measure(b, a) == measure(a, b)


def test_maps_apart_share_nothing() -> None:
    assert measure(raster(["#."]), raster(["#."], (5, 5))) == Evidence(0.0, 0.0, 0.0, 0.0, 0.0)


def test_rasters_of_different_resolution_are_refused() -> None:
    with pytest.raises(ValueError, match="resolution"):
        measure(raster(["#"]), raster(["#"], resolution=0.5))


STANDING = Standing(odds=30.0, firmness=0.9, rivalry=0.1, guided=False)


def test_good_evidence_is_believed() -> None:
    assert reason_against(GOOD, STANDING, Acceptance()) is None


@pytest.mark.parametrize(
    ("change", "standing", "word"),
    [
        ({"overlap_area": 3.9}, {}, "overlap"),
        ({"open_area": 2.9}, {}, "free in both"),
        ({"omega": 0.89}, {}, "omega"),
        ({"agreement": 0.39}, {}, "agreement of the walls"),
        ({"conflict": 0.16}, {}, "conflict"),
        ({}, {"odds": 11.9}, "evidence"),
        ({}, {"odds": -0.1, "guided": True}, "evidence"),
        ({}, {"firmness": 0.24}, "firmness"),
        ({}, {"rivalry": 0.51}, "ambiguity"),
        ({}, {"rivalry": np.nan}, "ambiguity"),
    ],
)
def test_every_limit_can_refuse(change: dict, standing: dict, word: str) -> None:
    reason = reason_against(replace(GOOD, **change), replace(STANDING, **standing), Acceptance())
    assert reason is not None
    assert word in reason
    assert "\n" not in reason


def test_a_prior_needs_less_evidence() -> None:
    weak = replace(STANDING, odds=0.5)
    assert reason_against(GOOD, weak, Acceptance()) is not None
    assert reason_against(GOOD, replace(weak, guided=True), Acceptance()) is None


def test_odds_by_hand() -> None:
    """A hundred cells that agree, without and with ten that do not, against chance (0.1 of conflicts)."""
    assert odds(100.0, 0.0) == pytest.approx(100.0 * np.log(0.999 / 0.9))
    changed = 0.5 * (100.0 * np.log(0.95 / 0.9) + 10.0 * np.log(0.05 / 0.1))
    assert odds(100.0, 10.0) == pytest.approx(changed)
    assert odds(100.0, 30.0) < 0.0
    assert odds(200.0, 1.0) > odds(100.0, 1.0) > odds(100.0, 3.0)


def test_a_rival_is_disproved_by_conflicts_alone() -> None:
    assert rivalry((100.0, 0.0), (90.0, 0.0)) == pytest.approx(0.9)
    assert rivalry((100.0, 0.0), (300.0, 0.0)) == 1.0
    assert rivalry((100.0, 0.0), (98.0, 2.0)) == pytest.approx(0.98 * 0.5)
    assert rivalry((100.0, 0.0), (90.0, 10.0)) == 0.0


def test_far_from_the_prior() -> None:
    prior, sigma = Prior(np.zeros(3), np.diag([1.0, 1.0, 0.1]) ** 2), 1e-4 * np.eye(3)
    assert far_from(None, np.array([9.0, 0.0, 0.0]), sigma, Acceptance()) is None
    assert far_from(prior, np.array([4.0, 0.0, 0.0]), sigma, Acceptance()) is None
    reason = far_from(prior, np.array([4.1, 0.0, 0.0]), sigma, Acceptance())
    assert reason is not None
    assert "prior" in reason
