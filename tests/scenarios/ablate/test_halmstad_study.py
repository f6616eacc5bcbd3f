"""Real maps, as drawn here and as they are: annotated pairs, two pieces of one building."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from scenarios.ablate.options import HalmstadOptions as Options
from scenarios.ablate.study.halmstad import (
    FITS,
    RESOLUTION,
    annotated_pairs,
    read_map,
    run,
    score,
    shared_walls,
)
from slam import se2
from stitch.align import Alternative, NoStitch, Stitch

TURN = np.radians(90.0)
T_A_B = np.array([3.0, -2.0, TURN])
"""Where map b lies in map a, m."""


def rooms(pixels: int = 240) -> np.ndarray:
    """Walls of three rooms, black on white, seen from inside; grey is unknown."""
    picture = np.full((pixels, pixels), 205, dtype=np.uint8)
    cv2.rectangle(picture, (20, 30), (200, 150), 255, -1)
    cv2.rectangle(picture, (20, 30), (200, 150), 0, 2)
    cv2.line(picture, (80, 30), (80, 100), 0, 2)
    cv2.line(picture, (140, 70), (200, 70), 0, 2)
    return picture


def building(folder: Path, scale: float = 1.0) -> None:
    """Maps one and two with keypoints: two is one seen from `T_A_B`; ``scale`` spoils its keypoints."""
    folder.mkdir(parents=True)
    points_a = np.array([[20.0, 40.0], [200.0, 60.0], [110.0, 190.0], [50.0, 150.0]])
    points_b = se2.transform(se2.inverse(T_A_B), points_a * RESOLUTION) / RESOLUTION
    for name, points in (("one", points_a), ("two", scale * points_b)):
        assert cv2.imwrite(str(folder / f"{name}.png"), rooms())
        np.save(folder / f"keypoints_{name}.npy", points)
    np.save(folder / "association_one_two.npy", np.stack([np.arange(4)] * 2, -1))


def test_annotations_give_the_similarity_back(tmp_path: Path) -> None:
    building(tmp_path / "b", scale=1.1)
    (pair,) = annotated_pairs(tmp_path / "b")
    assert pair.scale == pytest.approx(1.0 / 1.1)
    assert pair.residual == pytest.approx(0.0, abs=1e-9)
    np.testing.assert_allclose(pair.errors(T_A_B, 1.0 / 1.1), 0.0, atol=1e-9)
    np.testing.assert_allclose(pair.errors(T_A_B + np.array([0.3, 0.4, 0.0]), 1.0 / 1.1), 0.5)


def test_pickled_annotations_are_never_loaded(tmp_path: Path) -> None:
    building(tmp_path / "b")
    np.save(tmp_path / "b" / "association_one_two.npy", np.array([{"a": 1}], dtype=object), allow_pickle=True)
    assert annotated_pairs(tmp_path / "b") == []


def test_a_floor_plan_comes_first(tmp_path: Path) -> None:
    building(tmp_path / "b")
    for name in ("{}.png", "keypoints_{}.npy", "association_one_{}.npy"):
        (tmp_path / "b" / name.format("two")).rename(tmp_path / "b" / name.format("two_layout"))
    (tmp_path / "b" / "association_one_two_layout.npy").rename(
        tmp_path / "b" / "association_two_layout_one.npy"
    )
    (pair,) = annotated_pairs(tmp_path / "b")
    assert (pair.a, pair.b, pair.is_plan) == ("two_layout", "one", True)


def test_the_best_candidate_is_scored_accepted_or_not(tmp_path: Path) -> None:
    building(tmp_path / "b")
    (pair,) = annotated_pairs(tmp_path / "b")
    off = T_A_B + np.array([3.0, 4.0, 0.0])
    refused = score("b", "joint", pair, NoStitch("why", Alternative(off, 1.0)), 0.1)
    assert (refused.accepted, refused.wrong, refused.error_m) == (False, False, pytest.approx(5.0))
    accepted = score("b", "joint", pair, Stitch(off, None, 1.0, 1.0, 1.0), 0.1)
    assert (accepted.accepted, accepted.wrong) == (True, True)
    nothing = score("b", "joint", pair, NoStitch("why"), 0.1)
    assert np.isnan(nothing.error_m)


def test_shared_walls_by_hand(tmp_path: Path) -> None:
    picture = np.full((40, 40), 255, dtype=np.uint8)
    picture[10, 5:35] = 0
    assert cv2.imwrite(str(tmp_path / "wall.png"), picture)
    wall = read_map(tmp_path / "wall.png", 0.1)
    assert shared_walls(wall, wall, np.zeros(3), 0.05) == 1.0
    assert shared_walls(wall, wall, np.array([0.0, 0.5, 0.0]), 0.3) == 0.0
    # ten of thirty cells slide off its end, three of them by no more than the reach
    assert shared_walls(wall, wall, np.array([1.0, 0.0, 0.0]), 0.3) == pytest.approx(23 / 30)


def test_the_study_draws_the_pieces_beside_the_published_map(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pieces = tmp_path / "maps" / "exp3"
    pieces.mkdir(parents=True)
    for name in ("part1", "part2", "full"):
        assert cv2.imwrite(str(pieces / f"{name}.png"), rooms())
    run(Options(data=tmp_path, methods="joint", format="json", out=tmp_path / "out"))
    told = json.loads(capsys.readouterr().out)
    assert told["pairs"] == []
    assert told["exp3"][0]["share"] > 0.8
    assert not told["exp3"][0]["accepted"]  # walls only: nothing could have spoken against it
    picture = cv2.imread(str(tmp_path / "out" / "exp3.png"))
    assert picture is not None
    assert picture.shape[1] > 1.5 * picture.shape[0] / 2


def test_halmstad_has_the_pairs_that_are_reported(shared_data: Path) -> None:
    found = {name: annotated_pairs(shared_data / "halmstad" / name) for name in ("E5", "HIH")}
    counts = {
        name: (sum(not p.is_plan for p in pairs), sum(not p.is_plan and p.residual < FITS for p in pairs))
        for name, pairs in found.items()
    }
    assert counts == {"E5": (91, 82), "HIH": (3, 3)}
    assert {name: sum(pair.is_plan for pair in pairs) for name, pairs in found.items()} == {
        "E5": 14,
        "HIH": 3,
    }
