"""python -m stitch on bent maps: what it tells and draws, and what it refuses without writing anything."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from slam import se2
from slam.formats import ros_map
from slam.mapping.submap import Submap
from stitch.align import AlignConfig, Stitch, align
from stitch.alignment.bend import Bend
from stitch.alignment.config import TolerantConfig
from stitch.command import maps, merge
from tests.stitch.alignment import bent_rooms
from tests.stitch.command.test_command import run_command


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Maps a and b of one house, b bent and its frame turned by 0.5 rad, and other of another house."""
    folder = tmp_path_factory.mktemp("bent")
    for names, submaps in ((("a", "b"), bent_rooms.pair()), (("a", "other"), bent_rooms.strangers())):
        for name, submap in zip(names, submaps, strict=True):
            ros_map.write(folder / f"{name}.yaml", submap.grid, 0.5 if name == "b" else 0.0)
    return folder


@pytest.fixture(scope="module")
def answer(folder: Path) -> dict:  # type: ignore[type-arg]
    """What is told of a and b in JSON, both drawn as merged."""
    finished = run_command(folder / "a.yaml", folder / "b.yaml", "--format", "json", "-o", folder / "merged")
    assert finished.code == 0, finished.stderr
    told: dict = json.loads(finished.stdout)  # type: ignore[type-arg]
    return told


def test_json_tells_the_rigid_part_the_field_and_how_sure(answer: dict) -> None:  # type: ignore[type-arg]
    bend = answer["bend"]
    off = np.array(bend["displacements"])
    assert off.shape == (len(bend["knots"]), 3)
    assert bend["largest_displacement_m"] == pytest.approx(np.max(np.hypot(off[:, 0], off[:, 1])))
    assert 0.3 < bend["largest_displacement_m"] < 1.5
    assert answer["scale"] == 1.0
    assert len(answer["std"]) == 3
    assert 1 <= len(answer["alternatives"]) <= 4
    assert all(len(other["std"]) == 3 and other["belief"] < 0.5 for other in answer["alternatives"])


def test_the_field_holds_in_the_frames_of_the_maps(answer: dict, folder: Path) -> None:  # type: ignore[type-arg]
    """Knots and displacements, put together, lay the knots near walls where they truly lie."""
    knots = np.array(answer["bend"]["knots"])
    placed = (
        se2.transform(np.array(answer["T_a_b"]), knots) + np.array(answer["bend"]["displacements"])[:, :2]
    )
    grid = bent_rooms.pair()[1].grid
    turned = se2.compose([*grid.origin, 0.5], se2.inverse([*grid.origin, 0.0]))
    truth = bent_rooms.true_places(se2.transform(se2.inverse(turned), knots))
    shared = (truth[:, 0] > 9.0) & (truth[:, 0] < 20.0) & (truth[:, 1] > 0.0) & (truth[:, 1] < 16.0)
    assert np.mean(np.linalg.norm((placed - truth)[shared], axis=1)) < 0.25


def test_the_merged_map_is_bent_and_its_picture_shows_the_grid(answer: dict, folder: Path) -> None:  # type: ignore[type-arg]
    assert answer["accepted"]
    picture = cv2.imread(str(folder / "merged.png"))
    assert picture is not None
    blue = np.all(np.abs(picture.astype(int) - (0xEE, 0xC5, 0x8F)) < 40, axis=-1)
    assert blue.sum() > 200
    merged = ros_map.read_map(folder / "merged.yaml").grid
    a = bent_rooms.pair()[0].grid
    assert merged.occupied.sum() > a.occupied.sum()


def test_a_bent_grid_lies_where_its_places_truly_are() -> None:
    a, b = bent_rooms.pair()
    stitch = align(a, b, None, AlignConfig(tolerant=TolerantConfig(enabled=True)))
    assert isinstance(stitch, Stitch)
    far = []
    for one in (replace(stitch, bend=None), stitch):
        grid = merge.bent(b.grid, one)
        assert grid.free.sum() == pytest.approx(b.grid.free.sum(), rel=0.05)
        walls = se2.transform(stitch.T_a_b, grid.occupied_points())
        shared = walls[(walls[:, 0] > 9.0) & (walls[:, 0] < 20.0)]
        far.append(np.mean([np.linalg.norm(a.points.points - wall, axis=1).min() for wall in shared[::10]]))
    assert far[1] < 0.15
    assert far[1] < 0.6 * far[0]


def test_the_belief_in_a_bent_answer_is_not_told_as_a_probability() -> None:
    rigid = Stitch(np.zeros(3), None, 9.0, 20.0, 1.0, belief=1.0)
    bent = replace(rigid, bend=Bend(np.zeros(2), 4.0, np.zeros((2, 2, 3))).moved_to(np.zeros(3)))
    assert "% that it is right at all" in maps.as_text(rigid, "a", "b")
    assert "not calibrated" in maps.as_text(bent, "a", "b")


def test_never_draws_it_rigid(folder: Path) -> None:
    finished = run_command(folder / "a.yaml", folder / "b.yaml", "--format", "json", "--bend", "never")
    assert finished.code == 0
    assert json.loads(finished.stdout)["bend"] is None


def test_strangers_are_refused_nothing_is_written_but_the_reason(folder: Path, tmp_path: Path) -> None:
    words = ("-o", tmp_path / "merged", "--explain", tmp_path / "why.png")
    finished = run_command(folder / "a.yaml", folder / "other.yaml", *words)
    assert finished.code == 3
    assert "as bent maps: " in finished.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["why.png"]
    picture = cv2.imread(str(tmp_path / "why.png"))
    assert picture is not None
    assert picture.shape[1] > 1.5 * picture.shape[0]  # three hypotheses side by side


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (("--scale", "--all"), "--scale is for two maps and --method joint"),
        (("--bend", "always", "--method", "orb"), "--bend is for two maps and --method joint"),
        (("--explain", "why.jpg"), "--explain why.jpg: expected the name of a picture"),
    ],
)
def test_options_that_make_no_sense_together(folder: Path, words: tuple[str, ...], expected: str) -> None:
    finished = run_command(folder / "a.yaml", folder / "b.yaml", *words)
    assert finished.code == 2
    assert expected in finished.stderr


def test_a_bend_that_would_fold_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    from stitch.alignment import tolerant

    monkeypatch.setattr(Bend, "least_jacobian", lambda self, points: -0.5)
    a: Submap = bent_rooms.pair()[0]
    result = tolerant.bend_stitch(a, a, Stitch(np.zeros(3), None, 1.0, 1.0, 1.0), AlignConfig())
    assert not isinstance(result, Stitch)
    assert "would fold" in result.reason
