"""What speaks for an alignment, and what against."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from stitch.alignment.config import Acceptance
from stitch.alignment.likelihood import OverlapCounts
from stitch.alignment.raster import Raster
from stitch.alignment.verification import CandidateScores, SharedArea, measure_shared_area, reason_against

GOOD = SharedArea(overlap_area=20.0, open_area=15.0, agreement=0.9)
LIMITS = Acceptance(min_lead=2.0, max_ambiguity=0.4, min_belief=1.0)


def raster(rows: list[str], first: tuple[int, int] = (0, 0), resolution: float = 1.0) -> Raster:
    """'#' occupied, '.' free, ' ' unknown; the first string is the lowest row."""
    cells = np.array([list(row) for row in rows])
    return Raster(cells == "#", cells == ".", np.array(first, dtype=float), resolution)


def test_by_hand() -> None:
    a = raster(["#....", "#....", "     "])
    b = raster(["#...#", "     ", "     "])
    shared = measure_shared_area(a, b)
    assert shared.overlap_area == 5.0
    assert shared.open_area == 3.0
    # b has two walls in the overlap: one shared, one in a's free space; a has two, both near a wall of b
    assert shared.agreement == pytest.approx(0.5)


def test_offsets_and_resolution_count() -> None:
    a = raster(["....", "...."], (10, 5), 0.5)
    b = raster(["....", "...."], (12, 6), 0.5)
    assert measure_shared_area(a, b).overlap_area == pytest.approx(2 * 0.25)
    assert measure_shared_area(b, a) == measure_shared_area(a, b)


def test_maps_apart_share_nothing() -> None:
    assert measure_shared_area(raster(["#."]), raster(["#."], (5, 5))) == SharedArea(0.0, 0.0, 0.0)


def test_rasters_of_different_resolution_are_refused() -> None:
    with pytest.raises(ValueError, match="resolution"):
        measure_shared_area(raster(["#"]), raster(["#"], resolution=0.5))


SCORES = CandidateScores(
    log_odds=30.0,
    rivals=(2.5, 1.0),
    positional_distinctness=0.9,
    overlap=OverlapCounts(np.zeros((2, 3, 7), dtype=np.int64), np.zeros(3, dtype=np.int64)),
    prior_penalty=0.0,
    has_prior=False,
)


def test_a_good_alignment_is_believed() -> None:
    assert reason_against(GOOD, SCORES, 5.0, LIMITS) is None
    assert reason_against(GOOD, replace(SCORES, rivals=()), 5.0, Acceptance()) is None


@pytest.mark.parametrize(
    ("change", "score", "belief", "word"),
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
        ({}, {"positional_distinctness": 0.05}, 0.9, "slides along its walls"),
        ({}, {"rivals": (27.0,)}, 0.9, "a rival has 27.0 where it has 30.0"),
        ({}, {}, np.nan, "belief"),
        ({}, {"rivals": (12.3,)}, 5.0, "ambiguity: a rival has 0.41 of the log-odds, expected at most 0.4"),
    ],
)
def test_every_limit_can_refuse(change: dict, score: dict, belief: float, word: str) -> None:
    reason = reason_against(replace(GOOD, **change), replace(SCORES, **score), belief, LIMITS)
    assert reason is not None
    assert word in reason
    assert "\n" not in reason
