"""What speaks for an alignment, and what against."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from stitch.raster import Raster
from stitch.verification import Acceptance, Evidence, measure, reason_against

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


def test_good_evidence_is_believed() -> None:
    assert reason_against(GOOD, 0.3, 2.0, Acceptance()) is None
    assert reason_against(GOOD, None, None, Acceptance()) is None


@pytest.mark.parametrize(
    ("change", "ratio", "innovation", "word"),
    [
        ({"overlap_area": 3.9}, None, None, "overlap"),
        ({"open_area": 2.9}, None, None, "free in both"),
        ({"omega": 0.89}, None, None, "omega"),
        ({"agreement": 0.39}, None, None, "agreement of the walls"),
        ({"conflict": 0.06}, None, None, "conflict"),
        ({}, 0.91, None, "ambiguity"),
        ({}, None, 16.3, "prior"),
        ({}, None, np.nan, "prior"),
    ],
)
def test_every_limit_can_refuse(change: dict, ratio: float, innovation: float, word: str) -> None:
    reason = reason_against(replace(GOOD, **change), ratio, innovation, Acceptance())
    assert reason is not None
    assert word in reason
    assert "\n" not in reason
