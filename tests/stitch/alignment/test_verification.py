"""What speaks for an alignment, and what against."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from stitch.alignment.likelihood import Tally
from stitch.alignment.raster import Raster
from stitch.alignment.result import Prior
from stitch.alignment.verification import (
    NOTHING,
    Acceptance,
    Evidence,
    Standing,
    far_from,
    measure,
    reason_against,
)

GOOD = Evidence(overlap_area=20.0, open_area=15.0, agreement=0.9)
LIMITS = Acceptance(min_lead=2.0, max_rivalry=0.4, min_belief=1.0)


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


STANDING = Standing(
    odds=30.0,
    rivals=(2.5, 1.0),
    firmness=0.9,
    tally=Tally(np.zeros((2, 3, 7), dtype=np.int64), np.zeros(3, dtype=np.int64)),
    unlikely=0.0,
    guided=False,
)


def test_good_evidence_is_believed() -> None:
    assert reason_against(GOOD, STANDING, 5.0, LIMITS) is None
    assert reason_against(GOOD, replace(STANDING, rivals=()), 5.0, Acceptance()) is None


@pytest.mark.parametrize(
    ("change", "standing", "belief", "word"),
    [
        ({"overlap_area": 3.9}, {}, 5.0, "overlap 3.9 m², expected at least 4 m²"),
        ({"open_area": 2.9}, {}, 5.0, "free in both"),
        ({}, {"rivals": (28.5,)}, 5.0, "ambiguity: lead over a rival 1.5, expected at least 2"),
        ({}, {"rivals": (31.0,)}, 5.0, "ambiguity"),
        ({}, {"rivals": (np.nan,)}, 5.0, "ambiguity"),
        (
            {},
            {},
            0.9,
            "belief (log-odds of being right) 0.9, expected at least 1 (its walls alone give 30.0)",
        ),
        ({}, {"firmness": 0.05}, 0.9, "slides along its walls"),
        ({}, {"rivals": (27.0,)}, 0.9, "a rival has 27.0 where it has 30.0"),
        ({}, {}, np.nan, "belief"),
        ({}, {"rivals": (12.3,)}, 5.0, "ambiguity: a rival has 0.41 of the log-odds, expected at most 0.4"),
    ],
)
def test_every_limit_can_refuse(change: dict, standing: dict, belief: float, word: str) -> None:
    reason = reason_against(replace(GOOD, **change), replace(STANDING, **standing), belief, LIMITS)
    assert reason is not None
    assert word in reason
    assert "\n" not in reason


def test_far_from_the_prior() -> None:
    prior, sigma = Prior(np.zeros(3), np.diag([1.0, 1.0, 0.1]) ** 2), 1e-4 * np.eye(3)
    assert far_from(None, np.array([9.0, 0.0, 0.0]), sigma, Acceptance()) is None
    assert far_from(prior, np.array([4.0, 0.0, 0.0]), sigma, Acceptance()) is None
    reason = far_from(prior, np.array([4.1, 0.0, 0.0]), sigma, Acceptance())
    assert reason is not None
    assert "prior" in reason
