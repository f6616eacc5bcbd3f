"""python -m stitch: what it finds, writes and prints, what it refuses, and what it cannot use."""

from __future__ import annotations

import contextlib
import io
import json
import os
import re
import subprocess
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from slam import se2
from slam.formats import ros_map
from slam.mapping.occupancy import Grid, dilated, draw
from slam.recording import Laser
from slam.se2 import Array

Plan = dict[str, Callable[..., Any]]
CHECKOUT = Path(__file__).resolve().parents[3]
ANGLES = np.radians(np.arange(-180.0, 180.0, 2.0))
"""Of the beams that the plan is seen with."""
POSES = {"a": np.array([6.0, 9.0, 0.4]), "b": np.array([16.0, 9.0, -2.5]), "c": np.array([24.0, 9.0, 1.3])}
SIDES = {"a": 0.05, "b": 0.1, "c": 0.05}
WINDOWS = {"a": (1.0, 15.0), "b": (8.0, 24.0), "c": (17.0, 29.0)}
"""Stretches of the plan that the maps are of; a and c hardly overlap."""


@dataclass(frozen=True)
class Finished:
    """Exit code and output of a command."""

    code: int
    stdout: str
    stderr: str


def run_command(*words: object) -> Finished:
    """``python -m stitch WORDS``, in this process."""
    from slam.cli import main
    from stitch.__main__ import COMMAND, Options, run

    stdout, stderr = io.StringIO(), io.StringIO()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "argv", ["stitch", *map(str, words)])
        with contextlib.redirect_stdout(stdout), contextlib.redirect_stderr(stderr):
            code = main(Options, COMMAND, run)
    return Finished(code, stdout.getvalue(), stderr.getvalue())


def mapped(plan: Plan, segments: Array, poses: Array, anchor: Array, side: float = 0.05) -> Grid:
    """The grid that a laser at world poses ``(N, 3)`` draws in the frame of ``anchor``: its rays are traced
    there, no image is turned."""
    ranges = plan["cast"](segments, poses)
    ranges = ranges + np.random.default_rng(7).normal(0.0, 0.01, ranges.shape)
    return draw(se2.between(anchor, poses), ranges, ANGLES, Laser(range_max=12.0), side)


@pytest.fixture(scope="module")
def maps(plan: Plan, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a.yaml, b.yaml and c.yaml of one building, other.yaml of another, and twins."""
    folder = tmp_path_factory.mktemp("maps")
    rng = np.random.default_rng(100)
    building = plan["rooms"](rng)
    for name, window in WINDOWS.items():
        poses = plan["walk"](rng, *window)
        ros_map.write(folder / f"{name}.yaml", mapped(plan, building, poses, POSES[name], SIDES[name]))
    strange = plan["rooms"](np.random.default_rng(101))
    ros_map.write(folder / "other.yaml", mapped(plan, strange, plan["walk"](rng, 2.0, 28.0), POSES["b"]))
    for name, grid in twins(plan).items():
        ros_map.write(folder / f"{name}.yaml", grid)
    return folder


def twins(plan: Plan) -> dict[str, Grid]:
    """Two rooms alike side by side, and one of them alone: it fits either."""
    room = [*plan["box"](0.0, 0.0, 6.0, 5.0), *plan["box"](1.0, 3.5, 2.5, 4.2), [6.0, 1.0, 5.0, 1.0]]
    left = np.array(room)
    right = left + np.array([6.2, 0.0, 6.2, 0.0])
    inside = np.array([[x, y, 0.0] for x in (1.5, 3.0, 4.5) for y in (1.0, 2.5)])
    both = np.concatenate([inside, inside + np.array([6.2, 0.0, 0.0])])
    anchor = np.array([3.0, 2.0, 0.7])
    return {
        "twins": mapped(plan, np.concatenate([left, right]), both, np.zeros(3)),
        "twin": mapped(plan, left, inside, anchor),
    }


def truth(a: str, b: str) -> Array:
    return se2.between(POSES[a], POSES[b])


def error_of(T_a_b: Sequence[float], a: str, b: str) -> tuple[float, float]:
    """Error of a pose in m and degrees."""
    error = se2.between(truth(a, b), np.array(T_a_b))
    return float(np.hypot(error[0], error[1])), float(np.degrees(abs(error[2])))


def is_true(T_a_b: Sequence[float], a: str, b: str) -> bool:
    off, turned = error_of(T_a_b, a, b)
    return off < 0.1 and turned < 0.5


KEYS = ["accepted", "T_a_b", "std", "overlap_m2", "agreement", "margin", "reason", "alternatives", "belief"]
KEYS += ["scale", "bend"]


def test_json_says_where_and_how_sure(maps: Path) -> None:
    finished = run_command(maps / "a.yaml", maps / "b.yaml", "--format", "json")
    assert (finished.code, finished.stderr) == (0, "")
    answer = json.loads(finished.stdout)
    assert list(answer) == KEYS
    assert answer["accepted"] is True
    assert answer["reason"] is None
    off, turned = error_of(answer["T_a_b"], "a", "b")
    assert off < 0.03
    assert turned < 0.3
    error = np.array(answer["T_a_b"]) - truth("a", "b")
    assert np.all(np.abs(error) < 3.0 * np.array(answer["std"]))
    assert np.all(np.array(answer["std"]) < [0.2, 0.2, 0.02])
    assert 30.0 < answer["overlap_m2"] < 300.0
    assert answer["agreement"] > 0.8
    best = answer["alternatives"][0] if answer["alternatives"] else None
    assert (best is None) == (answer["margin"] is None)
    assert 0.5 <= answer["belief"] <= 1.0
    assert best is None or (set(best) == {"T_a_b", "score"} and answer["margin"] > 0.0)


def test_help_names_every_option_and_loads_nothing_slow() -> None:
    code = (
        "import sys; sys.argv = ['stitch', '--help']\n"
        "from stitch.__main__ import COMMAND, Options, run, main\n"
        "try: main(Options, COMMAND, run)\n"
        "finally: print(*sys.modules, file=sys.stderr)"
    )
    finished = subprocess.run(
        [sys.executable, "-c", code], cwd=CHECKOUT, capture_output=True, text=True, check=False
    )
    assert finished.returncode == 0
    for option in (
        "A.yaml B.yaml",
        "-o NAME",
        "--prior X Y YAW",
        "--prior-sigma",
        "--all",
        "--method",
        "--format",
    ):
        assert option in finished.stdout
    assert set(finished.stderr.split()) & {"numba", "gtsam", "cv2", "matplotlib", "scipy", "yaml"} == set()


def test_text_from_the_shell_and_the_files(maps: Path, tmp_path: Path) -> None:
    command = [sys.executable, "-m", "stitch", str(maps / "a.yaml"), str(maps / "b.yaml"), "-o", "new/joint"]
    environment = os.environ | {"PYTHONPATH": str(CHECKOUT)}
    finished = subprocess.run(
        command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False
    )
    assert (finished.returncode, finished.stderr) == (0, "")
    lines = finished.stdout.splitlines()
    assert lines[0] == f"{maps / 'b.yaml'} in the frame of {maps / 'a.yaml'}"
    x, y, degrees, radians = re.findall(
        r"x +(\S+) ± \S+ m\n +y +(\S+) ± \S+ m\n +yaw +(\S+) ± \S+ ° +\((\S+) rad\)", finished.stdout
    )[0]
    assert is_true([float(x), float(y), float(radians)], "a", "b")
    assert float(degrees) == pytest.approx(np.degrees(float(radians)), abs=1e-2)
    assert lines[-3:] == ["new/joint.yaml", "new/joint.pgm", "new/joint.png"]
    assert sorted(path.name for path in (tmp_path / "new").iterdir()) == [
        "joint.pgm",
        "joint.png",
        "joint.yaml",
    ]
    check_merged(maps, tmp_path / "new" / "joint.yaml")


def check_merged(maps: Path, path: Path) -> None:
    """The merged map has a's frame, the finer cells, and what either map knows."""
    a, whole = ros_map.read(maps / "a.yaml"), ros_map.read(path)
    assert whole.resolution == 0.05
    column, row = np.round((a.origin - whole.origin) / 0.05).astype(int)
    np.testing.assert_allclose(whole.origin + 0.05 * np.array([column, row]), a.origin, atol=1e-9)
    known = a.occupied | a.free
    rows, columns = np.nonzero(known)
    rows, columns = rows + row, columns + column
    assert np.all(whole.occupied[rows, columns] >= a.occupied[known])
    assert np.all((whole.free | whole.occupied)[rows, columns])
    b = ros_map.read(maps / "b.yaml")
    at = (se2.transform(truth("a", "b"), b.occupied_points()) - whole.origin) / 0.05
    column_b, row_b = np.floor(at).astype(int).T
    near = dilated(whole.occupied)
    assert np.mean(near[row_b, column_b]) > 0.98
    both = 0.05**2 * known.sum() + 0.1**2 * (b.occupied | b.free).sum()
    assert 0.05**2 * (whole.occupied | whole.free).sum() < both - 30.0


def test_the_picture_shows_both_maps_and_what_they_share(maps: Path, tmp_path: Path) -> None:
    from matplotlib.image import imread

    assert run_command(maps / "a.yaml", maps / "b.yaml", "-o", tmp_path / "m.png").code == 0
    pixels = (imread(tmp_path / "m.png")[..., :3] * 255.0).round().astype(int)
    count = {c: np.sum(np.all(pixels == hex_of(c), axis=-1)) for c in ("#0072B2", "#E69F00", "#000000")}
    assert min(count.values()) > 1000


def hex_of(colour: str) -> list[int]:
    return [int(colour[k : k + 2], 16) for k in (1, 3, 5)]


@pytest.mark.parametrize("pair", [("a", "other"), ("twins", "twin")])
def test_not_sure_is_exit_code_3_with_the_reason_and_nothing_written(
    pair: tuple[str, str], maps: Path, tmp_path: Path
) -> None:
    files = [maps / f"{name}.yaml" for name in pair]
    finished = run_command(*files, "--format", "json", "-o", tmp_path / "new" / "m")
    assert finished.code == 3
    assert re.fullmatch(r"stitch: not sure: .+\n", finished.stderr)
    answer = json.loads(finished.stdout)
    assert list(answer) == KEYS
    assert answer["accepted"] is False
    assert answer["reason"] in finished.stderr
    assert answer["T_a_b"] is answer["std"] is answer["margin"] is None
    assert list(tmp_path.iterdir()) == []


def test_twins_are_ambiguous_and_a_prior_tells_them_apart(maps: Path) -> None:
    files = [maps / "twins.yaml", maps / "twin.yaml"]
    assert "ambiguity" in run_command(*files).stderr
    for x in (3.0, 9.2):
        prior = ["--prior", x, 2.0, 0.7, "--prior-sigma", 0.4, 0.4, 0.1]
        answer = json.loads(run_command(*files, *prior, "--format", "json").stdout)
        np.testing.assert_allclose(answer["T_a_b"], [x, 2.0, 0.7], atol=0.05)


def test_a_map_and_itself(maps: Path) -> None:
    answer = json.loads(run_command(maps / "a.yaml", maps / "a.yaml", "--format", "json").stdout)
    np.testing.assert_allclose(answer["T_a_b"], 0.0, atol=1e-3)


def turned_yaml(maps: Path, name: str, pose: Array) -> Path:
    """The same map, whose frame lies elsewhere: its corner is where ``pose (3,)`` puts it."""
    corner = ros_map.read_map(maps / f"{name}.yaml").T_map_grid
    x, y, yaw = se2.compose(pose, corner).tolist()
    path = maps / f"{name}_turned.yaml"
    text = (maps / f"{name}.yaml").read_text()
    path.write_text(re.sub(r"origin: .*", f"origin: [{x}, {y}, {yaw}]", text))
    return path


def test_a_yaw_of_the_origin_is_respected(maps: Path, tmp_path: Path) -> None:
    """The maps stay where they are, their frames move: a's by P, b's by Q."""
    P, Q = np.array([3.0, -7.0, 0.9]), np.array([-20.0, 5.0, -2.0])
    a, b = turned_yaml(maps, "a", P), turned_yaml(maps, "b", Q)
    expected = se2.compose(P, se2.compose(truth("a", "b"), se2.inverse(Q)))
    prior = ["--prior", *(expected + np.array([0.3, -0.2, 0.02])), "--prior-sigma", 0.5, 0.5, 0.05]
    for words in ([], prior):
        finished = run_command(a, b, "--format", "json", "-o", tmp_path / "m", *words)
        error = se2.between(expected, np.array(json.loads(finished.stdout)["T_a_b"]))
        assert np.all(np.abs(error) < [0.1, 0.1, 0.01])
    merged, known = ros_map.read_map(tmp_path / "m.yaml"), ros_map.read_map(a)
    assert merged.T_map_grid[2] == pytest.approx(0.9)
    walls = se2.transform(known.T_map_grid, known.grid.occupied_points())
    cells = (se2.transform(se2.inverse(merged.T_map_grid), walls)) / merged.grid.resolution
    column, row = np.floor(cells).astype(int).T
    assert merged.grid.occupied[row, column].all()


def test_nav2s_free_thresh_changes_nothing(maps: Path, tmp_path: Path) -> None:
    for name in ("a", "b"):
        text = (maps / f"{name}.yaml").read_text()
        (maps / f"{name}_nav2.yaml").write_text(re.sub("free_thresh: .*", "free_thresh: 0.25", text))
    usual, nav2 = (
        run_command(maps / f"a{end}.yaml", maps / f"b{end}.yaml", "--format", "json", "-o", tmp_path / "m")
        for end in ("", "_nav2")
    )
    assert nav2.stdout == usual.stdout
    merged = ros_map.read_map(tmp_path / "m.yaml")
    assert merged.states_unknown


def test_a_map_without_unknown_cells_is_no_evidence(maps: Path) -> None:
    grid = ros_map.read(maps / "a.yaml")
    ros_map.write(maps / "plan.yaml", replace(grid, free=~grid.occupied))
    finished = run_command(maps / "plan.yaml", maps / "a.yaml")
    assert finished.code == 3
    first, second = finished.stderr.splitlines()
    assert first.startswith(f"stitch: {maps / 'plan.yaml'}: no cell is unknown")
    assert "free in both 0 m²" in second


def test_the_image_beside_the_yaml_is_used_and_named(maps: Path) -> None:
    text = (maps / "a.yaml").read_text()
    (maps / "moved.yaml").write_text(text.replace("a.pgm", "/home/robot/maps/a.pgm"))
    finished = run_command(maps / "moved.yaml", maps / "a.yaml")
    assert finished.code == 0
    assert "image /home/robot/maps/a.pgm is not there, a.pgm beside the yaml is used" in finished.stderr


def test_other_methods_have_no_deviations(maps: Path) -> None:
    words = [maps / "a.yaml", maps / "a.yaml", "--method", "htms"]
    finished = run_command(*words, "--format", "json")
    answer = json.loads(finished.stdout)
    assert finished.code == 0
    assert answer["std"] is None
    np.testing.assert_allclose(answer["T_a_b"], 0.0, atol=0.05)
    assert "the method tells nothing of how sure it is" in run_command(*words).stdout


def test_all_joins_what_hangs_together_and_names_the_rest(maps: Path, tmp_path: Path) -> None:
    names = ["a", "c", "other", "b"]
    files = [maps / f"{name}.yaml" for name in names]
    finished = run_command("--all", *files, "-o", tmp_path / "m")
    assert finished.code == 0
    assert finished.stderr == f"stitch: {files[2]} is left out: it does not hang together with the first\n"
    assert len(re.findall(r" joined +-?\d", finished.stdout)) >= 2
    for column in ("map", "in the frame of", "x [m]", "yaw [°]", "overlap [m²]", "verdict"):
        assert column in finished.stdout
    whole = ros_map.read(tmp_path / "m.yaml")
    for name in ("a", "b", "c"):
        points = ros_map.read(maps / f"{name}.yaml").occupied_points()
        at = (se2.transform(truth("a", name), points) - whole.origin) / whole.resolution
        column, row = np.floor(at).astype(int).T
        assert np.mean(dilated(dilated(whole.occupied))[row, column]) > 0.95

    finished = run_command("--all", *files, "--format=json")
    answer = json.loads(finished.stdout)
    assert answer["accepted"] is True
    assert answer["left_out"] == [str(files[2])]
    assert len(answer["pairs"]) == 6
    for name, entry in zip(("a", "c", "b"), answer["maps"], strict=True):
        assert entry["map"] == str(maps / f"{name}.yaml")
        assert is_true(entry["T_first_map"], "a", name)
        assert len(entry["std"]) == 3


def test_all_with_nothing_to_join(maps: Path, tmp_path: Path) -> None:
    finished = run_command("--all", maps / "a.yaml", maps / "other.yaml", "-o", tmp_path / "m")
    assert finished.code == 3
    assert finished.stderr == f"stitch: not sure: no map could be joined to {maps / 'a.yaml'}\n"
    assert "no: " in finished.stdout
    assert list(tmp_path.iterdir()) == []
