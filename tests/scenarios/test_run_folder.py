import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from scenarios.jsonable import document, jsonable
from scenarios.report.page import facts
from scenarios.run import run_name
from scenarios.run_folder.directory import check, fingerprint, prepare, publish, safe_name, vacant_name
from scenarios.run_folder.write import Run, segments, stitches
from slam.cli import InputError
from slam.mapping.occupancy import Grid
from slam.mapping.submap import Submap
from slam.odometry.track import Verdict
from slam.recording import Laser, Recording
from slam.scan import Scan
from stitch.align import Alternative, NoStitch, Stitch
from stitch.mapping.estimate import Estimate, LoopCandidate

TRUTH = np.column_stack([np.arange(4.0), np.zeros(4), np.zeros(4)])


def submap(start: int, stop: int) -> Submap:
    empty, cells = np.zeros((0, 2)), np.zeros((1, 1), dtype=bool)
    scan = Scan(empty, empty, empty, np.zeros((0, 2, 2)), np.zeros(0), np.zeros(0, dtype=int))
    return Submap(start, stop, np.zeros(3), scan, Grid(cells, cells, np.zeros(2), 0.05))


def stitch(x: float, yaw: float = 0.0, **kwargs) -> Stitch:
    return Stitch(np.array([x, 0.0, yaw]), np.eye(3), 7.0, 2.0, 0.9, **kwargs)


ESTIMATE = Estimate(
    "m",
    TRUTH,
    submaps=(submap(0, 2), submap(2, 3), submap(3, 4)),
    stitches=(
        LoopCandidate(0, 1, stitch(2.1), 1.0),
        LoopCandidate(0, 2, stitch(3.5), 1.0),
        LoopCandidate(1, 2, stitch(1.0, np.radians(5), alternatives=(Alternative(np.zeros(3), 1.0),)), 0.0),
        LoopCandidate(1, 2, NoStitch("no overlap", Alternative(np.ones(3), 2.0))),
    ),
)


def test_every_stitch_is_written_with_its_true_error():
    good, false, rejected, none = jsonable(stitches([ESTIMATE], TRUTH)["m"])
    assert good["error_m"] == pytest.approx(0.1)
    assert (good["accepted"], good["false"]) == (True, False)
    assert false["error_m"] == pytest.approx(0.5)
    assert (false["accepted"], false["false"]) == (True, True)
    assert rejected["error_deg"] == pytest.approx(5.0)
    assert (rejected["accepted"], rejected["false"]) == (False, False)
    assert rejected["alternatives"] == [{"T_a_b": [0.0, 0.0, 0.0], "score": 1.0}]
    assert none["reason"] == "no overlap"
    assert none["best"] == {"T_a_b": [1.0, 1.0, 1.0], "score": 2.0}
    assert "false" not in none


def test_without_truth_a_stitch_has_no_error():
    assert not any({"error_m", "false"} & set(entry) for entry in stitches([ESTIMATE], None)["m"])


def test_methods_that_do_not_cut_have_no_segments():
    assert segments([Estimate("ins", TRUTH), ESTIMATE]) == {
        "m": [{"start": 0, "stop": 2}, {"start": 2, "stop": 3}, {"start": 3, "stop": 4}]
    }


@dataclass(frozen=True)
class Config:
    limit: float
    where: Path
    table: np.ndarray
    verdict: Verdict


def test_values_become_strict_json():
    config = Config(np.inf, Path("a/b"), np.array([[1.0, np.nan]]), Verdict.SKIPPED)
    assert jsonable({1: config, "n": (np.int64(3), None)}, words=True) == {
        "1": {"limit": "inf", "where": "a/b", "table": [[1.0, "nan"]], "verdict": "SKIPPED"},
        "n": [3, None],
    }
    assert json.loads(document(limit=np.inf, names=("a",))) == {"schema": 1, "limit": None, "names": ["a"]}


@pytest.mark.parametrize(
    ("name", "expected"), [("gmapping (published)", "gmapping_published"), ("../x", "x"), ("..", "unnamed")]
)
def test_names_are_plain_file_names(name, expected):
    assert safe_name(name) == expected


def test_a_folder_appears_whole_under_its_name(tmp_path):
    with prepare(tmp_path / "runs", "a") as folder:
        (folder.temporary / "metrics.json").write_text("{}")
        assert not folder.final.exists()
        publish(folder, {"cores": 2})
    assert sorted(path.name for path in folder.final.iterdir()) == ["environment.json", "metrics.json"]
    assert sorted(path.name for path in (tmp_path / "runs").iterdir()) == ["a", "latest"]
    check(tmp_path / "runs", "a")  # a run may be replaced


def test_what_others_put_into_a_new_folder_meanwhile_stays(tmp_path):
    with prepare(tmp_path / "x" / "runs", "a"):
        (tmp_path / "x" / "mine.txt").touch()
    assert [path.name for path in tmp_path.rglob("*")] == ["x", "mine.txt"]


def test_checking_makes_nothing(tmp_path):
    check(tmp_path / "x" / "y", "a")
    assert list(tmp_path.iterdir()) == []


def test_a_link_to_nowhere_is_no_folder(tmp_path):
    (tmp_path / "runs").symlink_to(tmp_path / "nowhere")
    with pytest.raises(InputError, match="is not a folder"):
        check(tmp_path / "runs", "a")


def test_recordings_of_one_name_have_runs_of_their_own(tmp_path):
    """The same recording again has its own run's name, also from elsewhere and after others."""
    runs = tmp_path / "runs"
    marks = []
    for folder, content in (("a", "one"), ("b", "another"), ("c", "one")):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "drive.log").write_text(content)
        marks.append(fingerprint(tmp_path / folder / "drive.log"))
    assert marks[0] == marks[2] != marks[1]
    for mark, expected in zip(marks * 2, ["drive", "drive-2", "drive"] * 2, strict=True):
        name = vacant_name(runs, "drive", mark)
        assert name == expected
        (runs / name).mkdir(parents=True, exist_ok=True)
        (runs / name / "config.json").write_text(json.dumps({"fingerprint": mark}))


@pytest.mark.parametrize("content", ["", "[]", "{}", "null", "no json"])
def test_a_run_that_does_not_tell_its_recording_may_be_replaced(tmp_path, content):
    (tmp_path / "drive").mkdir()
    (tmp_path / "drive/config.json").write_text(content)
    assert vacant_name(tmp_path, "drive", "abc") == "drive"


def test_maps_are_told_apart_by_their_image(tmp_path):
    marks = set()
    for folder, shade in (("a", b"0"), ("b", b"1")):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "map.yaml").write_text("image: map.pgm\n")
        (tmp_path / folder / "map.pgm").write_bytes(shade)
        marks.add(fingerprint(tmp_path / folder / "map.yaml"))
    assert len(marks) == 2


@pytest.mark.parametrize(
    ("target", "name"),
    [
        ("hospital", "hospital"),
        ("logs/drive.2024.log", "drive.2024"),
        ("drive.2025.log.gz", "drive.2025"),
        ("intel.raw.log.gz", "intel"),
        ("rosbag2_2024.01.02", "rosbag2_2024.01.02"),
        ("maps/floor.1.yaml", "floor.1"),
    ],
)
def test_a_run_is_named_after_all_that_tells_recordings_apart(target, name):
    assert run_name(target) == name


def test_a_log_has_no_seed():
    recording = Recording("log", np.arange(4.0), np.full((4, 3), 2.0), np.arange(3.0), Laser(), TRUTH)
    made = dict.fromkeys(("git", "python", "packages", "processor", "cores"), "x")
    run = Run({"command": "the command"}, made, 7, recording, [Estimate("ins", TRUTH)], [])
    assert facts(run)["command"] == "the command"
    assert "seed" not in facts(run)
