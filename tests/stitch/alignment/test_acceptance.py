"""The classifier of alignments."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from stitch.alignment.acceptance import (
    NO_RIVAL,
    AcceptanceClassifier,
    CandidateScores,
    SharedArea,
    features,
    measure_shared_area,
    reason_against,
)
from stitch.alignment.config import Acceptance
from stitch.alignment.likelihood import OverlapCounts
from stitch.alignment.raster import Raster

SHARED = SharedArea(overlap_area=30.0, open_area=20.0, agreement=0.9)


def scores(**changes: object) -> CandidateScores:
    """Two maps that share 400 points of steady wall and 50 of furniture, and contradict each other in 20."""
    counts = np.zeros((2, 3, 7), dtype=np.int64)
    counts[0, 0, :4] = 100
    counts[1, 0, 0] = 50
    counts[:, 1, 6] = 10
    overlap = OverlapCounts(counts, np.array([20, 3, 4]))
    usual = CandidateScores(
        log_odds=8.0,
        rivals=(-2.0,),
        positional_distinctness=0.6,
        overlap=overlap,
        prior_penalty=0.0,
        has_prior=False,
    )
    return replace(usual, **changes)  # type: ignore[arg-type]


def test_features_by_hand() -> None:
    x = features(SHARED, scores())
    assert x.shape == (39,)
    np.testing.assert_allclose(x[:6], [8.0, -2.0, NO_RIVAL, NO_RIVAL, 10.0, 0.6])
    np.testing.assert_allclose(x[6:10], [np.log(31.0), np.log(21.0), 0.9, 450 / 470])
    np.testing.assert_allclose(x[10:16], [10.0, 10.0, 10.0, 10.0, 0.0, 0.0])
    assert x[16] == pytest.approx(np.sqrt(50.0))
    np.testing.assert_allclose(x[24:26], np.log1p([400.0, 50.0]))
    np.testing.assert_allclose(x[26:32], np.log1p([0.0, 10.0, 0.0, 0.0, 10.0, 0.0]))
    np.testing.assert_allclose(x[32:37], [*np.log1p([20.0, 3.0, 4.0]), np.sqrt(3.0), 2.0])
    np.testing.assert_allclose(x[37:], [0.0, 0.0])


def test_features_are_finite_without_rivals_and_without_walls() -> None:
    bare = CandidateScores(-8.0, (), -np.inf, OverlapCounts(np.zeros((2, 3, 7)), np.zeros(3)), 3.0, True)
    assert np.all(np.isfinite(features(SharedArea(0.0, 0.0, 0.0), bare)))


def test_log_odds_by_hand() -> None:
    classifier = AcceptanceClassifier(
        mean=np.array([1.0, 0.0]),
        scale=np.array([2.0, 1.0]),
        inner=np.array([[1.0], [0.0]]),
        offset=np.array([0.5]),
        outer=np.array([3.0]),
        bias=np.array(-1.0),
    )
    assert classifier.log_odds(np.array([3.0, 9.0])) == pytest.approx(3.0 * np.tanh(1.5) - 1.0)
    assert classifier.log_odds(np.zeros((4, 5, 2))).shape == (4, 5)


def test_a_saved_classifier_is_the_same(tmp_path: Path) -> None:
    learnt = AcceptanceClassifier.learnt()
    learnt.save(tmp_path / "belief.npz")
    with np.load(tmp_path / "belief.npz") as stored:
        again = AcceptanceClassifier(**stored)
    x = features(SHARED, scores())
    assert again.log_odds(x) == pytest.approx(float(learnt.log_odds(x)), abs=1e-3)


def belief(of: CandidateScores) -> float:
    return float(AcceptanceClassifier.learnt().log_odds(features(SHARED, of)))


def test_what_speaks_for_and_against_an_alignment_moves_the_log_odds() -> None:
    """What no classifier that has learnt anything would have the other way round."""
    fair = belief(scores())
    assert belief(scores(log_odds=-3.0, rivals=(-3.5,))) < fair
    assert belief(scores(rivals=(7.5, 7.4, 7.3))) < fair
    overlap = scores().overlap
    contradicted, walled_up = overlap.counts.copy(), np.array([20, 3, 60])
    contradicted[:, 1, 6] = 300
    assert belief(scores(overlap=replace(overlap, counts=contradicted))) < fair
    assert belief(scores(overlap=replace(overlap, gaps=walled_up))) < fair
    assert belief(scores(log_odds=20.0, rivals=(-2.0,))) > fair
    assert fair > 0.0


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
