"""The study of published ROS maps: what counts as right, and the figures that were asked for."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from scenarios.ablate.options import RosMapsOptions
from scenarios.ablate.study import ros_maps
from scenarios.ablate.study.ros_maps import ITSELF, ONE_PLACE, WITH_PRIOR, bent_at, run
from slam.formats.ros_map import write
from slam.mapping.occupancy import Grid
from stitch.align import Stitch
from stitch.alignment.bend import Bend


def flat(doors: tuple[int, int]) -> Grid:
    """Three rooms of a flat, with doors; unknown outside."""
    occupied, inside = np.zeros((120, 200), dtype=bool), np.zeros((120, 200), dtype=bool)
    occupied[[4, 115], 4:196] = occupied[4:116, [4, 80, 150, 195]] = True
    occupied[doors[0] : doors[0] + 20, 80] = occupied[doors[1] : doors[1] + 20, 150] = False
    occupied[60, 4:50] = occupied[5:30, 120] = True
    inside[5:115, 5:195] = True
    return Grid(occupied, inside & ~occupied, np.array([-5.0, -3.0]), 0.05)


def test_every_pair_is_told_by_kind_and_place(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for place, name, doors in (
        ("home", "one", (20, 80)),
        ("home", "two", (20, 80)),
        ("away", "three", (85, 30)),
    ):
        (tmp_path / "ros_maps" / place).mkdir(parents=True, exist_ok=True)
        write(tmp_path / "ros_maps" / place / f"{name}.yaml", flat(doors))
    (tmp_path / "ros_maps" / "away" / "torn.yaml").write_text("image: nowhere.pgm\n")
    run(RosMapsOptions(data=tmp_path, format="json"))
    printed = capsys.readouterr()
    assert "not read: " in printed.err
    pairs = json.loads(printed.out)["pairs"]
    kinds = [(pair["kind"], pair["a"], pair["b"]) for pair in pairs]
    assert sorted(kind for kind, *_ in kinds) == sorted(
        [ITSELF] * 3 + [ONE_PLACE, WITH_PRIOR] + ["different places"] * 2
    )
    assert all(pair["outcome"] == "right" for pair in pairs if pair["place"] == "home")
    run(RosMapsOptions(data=tmp_path, places="home"))
    assert WITH_PRIOR in capsys.readouterr().out


def test_without_the_data_it_says_so(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run(RosMapsOptions(data=tmp_path))
    assert capsys.readouterr().err == f"skipped: {tmp_path / 'ros_maps'} is absent\n"


def test_as_published_hospital_and_maze_join_and_a_round_world_does_not(shared_data: Path) -> None:
    maps, unread = ros_maps.read_maps(shared_data / "ros_maps", "hospital,maze")
    assert not unread
    outcomes: dict[tuple[str, str], list[str]] = {}
    for result in ros_maps.join_all(maps):
        outcomes.setdefault((result.kind, result.place), []).append(result.outcome)
    assert outcomes[ONE_PLACE, "hospital"] == ["right"] * 3
    assert outcomes[WITH_PRIOR, "maze"] == ["right"] * 3
    assert not any("false" in several for several in outcomes.values())


def test_a_bent_answer_is_scored_where_the_bend_puts_the_middle() -> None:
    lattice = Bend(np.zeros(2), 4.0, np.zeros((3, 3, 3))).moved_to(np.zeros(3))
    nodes = lattice.nodes + np.array([0.4, -0.2, 0.0])
    stitch = Stitch(np.zeros(3), None, 1.0, 1.0, 1.0, bend=replace(lattice, nodes=nodes))
    moved = bent_at(stitch, np.array([2.0, 3.0]))
    assert isinstance(moved, Stitch)
    np.testing.assert_allclose(moved.T_a_b, [0.4, -0.2, 0.0], atol=1e-12)
    rigid = replace(stitch, bend=None)
    assert bent_at(rigid, np.zeros(2)) is rigid
