"""python -m scenarios.score as a user runs it."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from scenarios import export
from scenarios.run_folder.read import read_run
from scenarios.score import __main__ as score
from slam.cli import main
from slam.formats import answer, carmen, ros_map, tum
from slam.mapping.occupancy import Grid, draw
from slam.recording import Recording

Command = Callable[..., int]


@pytest.fixture
def command(monkeypatch: pytest.MonkeyPatch) -> Command:
    def command(*words: object) -> int:
        monkeypatch.setattr("sys.argv", ["score", *map(str, words)])
        return main(score.Options, score.COMMAND, score.run)

    return command


def values(text: str, method: str) -> dict[str, float | None]:
    return {m["metric"]: m["value"] for m in json.loads(text)["metrics"] if m["method"] == method}


def test_an_answer_stands_beside_our_methods_and_is_kept(
    log: Path, turning: Recording, command: Command, capsys: pytest.CaptureFixture[str]
) -> None:
    assert turning.truth is not None
    rng = np.random.default_rng(1)
    off = turning.truth + rng.normal(0.0, [0.02, 0.02, 0.01], (40, 3))
    off[0] = turning.truth[0]
    sigma = np.tile(np.diag([4e-4, 4e-4, 1e-4]), (40, 1, 1))
    tum.write("<i>theirs.tum", turning.time, off, sigma)
    assert command(log, "<i>theirs.tum", "--methods", "ins", "--format", "json") == 0
    told = capsys.readouterr()
    assert "<i>theirs: 40 poses, 100.0% of the scans within 0.02 s" in told.err
    theirs = values(told.out, "<i>theirs")
    assert theirs["coverage"] == 1.0
    assert theirs["ate_rmse"] == pytest.approx(0.028, abs=0.006)
    assert theirs["anees"] == pytest.approx(1.0, abs=0.35)
    assert theirs["anees_k"] == pytest.approx(1.0, abs=0.5)
    assert theirs["crps_trans"] == pytest.approx(0.02 / np.sqrt(np.pi), abs=0.003)
    assert values(told.out, "ins")["ate_rmse"] is not None
    folder = Path("runs/latest")
    assert folder.resolve().name == "room-seed0-score"
    _, estimates, _ = read_run(folder)
    assert [one.method for one in estimates] == ["ins", "<i>theirs"]
    np.testing.assert_allclose(estimates[1].covariance, sigma)  # type: ignore[arg-type]
    page = (folder / "report.html").read_text()
    assert "&lt;i&gt;theirs" in page
    assert "<i>theirs" not in page
    assert json.loads((folder / "config.json").read_text())["options"]["tolerance"] == 0.02


def test_what_covers_too_little_fails_beside_others_and_alone_is_refused(
    log: Path, turning: Recording, command: Command, capsys: pytest.CaptureFixture[str]
) -> None:
    assert turning.truth is not None
    tum.write("whole.tum", turning.time, turning.truth)
    tum.write("half.tum", turning.time[:20], turning.truth[:20])
    assert command(log, "half.tum") == 2
    assert "half: poses for 50 % of the scans, expected at least 90 %" in capsys.readouterr().err
    assert not Path("runs").exists()
    assert command(log, "half.tum", "whole.tum", "--format", "json") == 0
    told = capsys.readouterr().out
    assert values(told, "half")["ate_rmse"] is None
    assert values(told, "half")["coverage"] == 0.5
    assert values(told, "whole")["ate_rmse"] == pytest.approx(0.0, abs=1e-9)


def test_a_map_in_a_frame_of_its_own_is_laid_on_the_true_one(
    log: Path, turning: Recording, command: Command, capsys: pytest.CaptureFixture[str]
) -> None:
    assert turning.truth is not None
    moved = np.add(turning.truth, [7.0, -3.0, 0.0])
    ros_map.write("good.yaml", draw(moved, turning.ranges, turning.angles, turning.laser, 0.05))
    bent = moved.copy()
    bent[:, 2] *= 1.25
    ros_map.write("bent.yaml", draw(bent, turning.ranges, turning.angles, turning.laser, 0.05))
    assert command(log, "good.yaml", "bent.yaml", "--format", "json") == 0
    told = capsys.readouterr().out
    good, bad = values(told, "good (map)"), values(told, "bent (map)")
    assert good["map_f1"] == pytest.approx(1.0, abs=0.03)
    assert float(bad["map_f1"] or 0.0) < float(good["map_f1"] or 0.0) - 0.1
    assert good["ate_rmse"] is None


def test_the_log_comes_back_corrected_and_scores_as_the_answer(
    log: Path, turning: Recording, command: Command, capsys: pytest.CaptureFixture[str]
) -> None:
    assert turning.truth is not None
    tum.write("a.tum", turning.time, np.add(turning.truth, [1.0, 2.0, 0.0]))
    carmen.write("room.log", turning)
    options = export.Options("room.log", "carmen", Path("out.log"), poses=Path("a.tum"))
    export.run(options)
    assert Path("out.log").read_text().count("\n") == Path("room.log").read_text().count("\n")
    found = answer.read("out.log")
    np.testing.assert_allclose(found.poses, np.add(turning.truth, [1.0, 2.0, 0.0]), atol=2e-6)
    capsys.readouterr()
    assert command("room.log", "out.log", "--format", "json") == 0
    assert values(capsys.readouterr().out, "out")["ate_rmse"] == pytest.approx(0.0, abs=1e-5)


BAD = {
    "no answer": ((), "expected one or more answers"),
    "missing": (("no.tum",), "no.tum: no such file"),
    "nan": (("nan.tum",), "value 2 is 'nan', expected a finite number"),
    "other stamps": (("late.tum",), "late: none of its 40 stamps"),
    "a map that is none": (("no.yaml",), "no.yaml: no such file"),
    "tolerance": (("good.tum", "--tolerance", "-1"), "--tolerance: expected 0 to 1 s, got -1"),
    "method": (("good.tum", "--methods", "inz"), "unknown method 'inz': did you mean 'ins'"),
    "huge": (("huge.tum",), "10,000,000,000 bytes, expected a trajectory"),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_input_is_one_line_and_nothing_is_written(
    name: str, log: Path, turning: Recording, command: Command, capsys: pytest.CaptureFixture[str]
) -> None:
    assert turning.truth is not None
    tum.write("good.tum", turning.time, turning.truth)
    tum.write("late.tum", turning.time + 100.0, turning.truth)
    Path("nan.tum").write_text("1 nan 0 0 0 0 0 1\n")
    with Path("huge.tum").open("wb") as file:
        file.truncate(10_000_000_000)
    words, message = BAD[name]
    assert command(log, *words) == 2
    (line,) = (line for line in capsys.readouterr().err.splitlines() if line.startswith("scenarios.score:"))
    assert message in line
    assert not Path("runs").exists()


def test_a_grid_coarser_than_the_true_map_keeps_its_walls() -> None:
    from scenarios.score.maps import _cells

    occupied = np.zeros((2, 3), dtype=bool)
    occupied[0, 1] = True
    found = _cells(Grid(occupied, ~occupied, np.zeros(2), 0.1), np.zeros(3))
    np.testing.assert_array_equal(found, [[2, 0], [2, 1], [3, 0], [3, 1]])
