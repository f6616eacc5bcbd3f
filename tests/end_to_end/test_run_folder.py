"""A run's folder: everything is there, others can read it, and it is there whole or not at all."""

from __future__ import annotations

import csv
import json
import math
import re
from itertools import product
from pathlib import Path

import numpy as np
import pytest

from slam.formats import g2o, load, ros_map, tum

METHODS = ["ins", "icp", "wsm", "htms", "slamstitch"]


def strict(path: Path):
    """JSON as the standard has it: no NaN, no Infinity."""

    def refuse(word: str) -> None:
        raise AssertionError(f"{path.name}: {word} is not JSON")

    return json.loads(path.read_text(), parse_constant=refuse)


@pytest.fixture(scope="module")
def scans(drive):
    return len(load(drive))


def test_everything_is_there(done):
    found = {str(path.relative_to(done.folder)) for path in done.folder.rglob("*") if path.is_file()}
    drawn = [*METHODS, "truth"]
    figures = {path for path in found if path.startswith("figures/")}
    assert found - figures == {
        "config.json", "environment.json", "metrics.json", "segments.json", "stitches.json",
        "recording.npz", "report.html", "steps.csv", "tracks.npz", "submaps.npz", "self_consistency.json",
        *(f"trajectories/{name}.tum" for name in drawn),
        *(f"maps/{name}.{suffix}" for name in drawn for suffix in ("png", "pgm", "yaml")),
        "posegraphs/slamstitch-before.g2o", "posegraphs/slamstitch-after.g2o",
    }  # fmt: skip
    assert sorted(path.name for path in done.folder.parent.iterdir()) == ["drive-seed0", "latest"]


def test_every_figure_is_there_for_the_screen_and_for_print(done):
    names = {
        suffix: {path.stem for path in done.folder.glob(f"figures/*.{suffix}")} for suffix in ("png", "pdf")
    }
    assert names["png"] == names["pdf"]
    assert {"maps", "trajectories", "confidence-wsm", "confidence-slamstitch", "uncertainty"} < names["png"]
    assert "confidence-htms" not in names["png"]  # its track is that of wsm
    assert "submaps-slamstitch" in names["png"]


def test_config_tells_the_command_and_every_parameter(done, drive):
    from dataclasses import fields

    from scenarios.methods.config import MethodConfig
    from scenarios.run import Options

    config = strict(done.folder / "config.json")
    assert config["command"] == f"python -m scenarios.run {drive} --out {done.folder.parent}"
    assert set(config["options"]) == {field.name for field in fields(Options)}
    assert set(config["methods"]) == {field.name for field in fields(MethodConfig)}
    assert config["methods"]["slam"]["loops"]["align"]["acceptance"]["min_lead"] > 0.0
    assert config["scenario"] == {}


@pytest.mark.usefixtures("no_figures")
def test_config_of_a_simulation_tells_the_scenario_s_settings(command, walk, tmp_path):
    assert command(walk, "--methods", "ins", "--seed", "3", "--out", tmp_path).code == 0
    config = strict(tmp_path / "walk-seed3" / "config.json")
    assert config["options"]["seed"] == 3
    assert {"robot", "scanner", "inertial", "shock", "driver", "scan_interval"} <= set(config["scenario"])
    assert "world" not in config["scenario"]
    assert config["scenario"]["ending"] == "completed"


def test_environment_tells_versions_and_the_cost_of_every_stage(done):
    environment = strict(done.folder / "environment.json")
    assert re.match(r"\d+\.\d+", environment["packages"]["numpy"])
    assert environment["cores"] >= 1
    assert list(environment["stages"]) == ["read", "warm up", *METHODS, "evaluate", "report"]
    for cost in environment["stages"].values():
        assert cost["wall_s"] > 0.0
        assert cost["peak_mb"] is None or cost["peak_mb"] > 10.0


def test_metrics_are_all_there_with_a_value_or_a_reason(done, scans):
    from scenarios.evaluation import DEFINITIONS

    content = strict(done.folder / "metrics.json")
    assert content["schema"] == 1
    assert content["recording"] == "walk"
    assert (content["seed"], content["scans"]) == (0, scans)
    assert 15.0 < content["distance_m"] < 25.0
    assert {(m["method"], m["metric"]) for m in content["metrics"]} == set(product(METHODS, DEFINITIONS))
    assert len(content["metrics"]) == len(METHODS) * len(DEFINITIONS)
    for m in content["metrics"]:
        assert (m["value"] is None) == ("reason" in m)
        assert m["unit"] == DEFINITIONS[m["metric"]].unit


def test_the_recording_can_be_run_again(done, drive):
    again, original = load(done.folder / "recording.npz"), load(drive)
    for name in ("time", "ranges", "angles", "dead_reckoning", "attitude", "truth"):
        np.testing.assert_array_equal(getattr(again, name), getattr(original, name))


def test_steps_have_a_row_per_scan_and_method(done, scans):
    with (done.folder / "steps.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [(row["method"], int(row["scan"])) for row in rows] == [
        (method, scan) for method in METHODS[1:] for scan in range(scans)
    ]
    assert {row["verdict"] for row in rows} <= {"MATCHED", "FELL_BACK", "SKIPPED"}
    assert {"trace2", "det2", "neg_matches"} <= set(rows[0])
    for row in rows:
        first = row["reference"] == "-1"
        assert (row["error_trans"] == "") == first
        assert first or 0.0 <= float(row["error_trans"]) < 5.0
        assert first or 0.0 <= float(row["error_rot"]) <= math.pi


def test_segments_and_stitches_agree_with_the_metrics(done, scans):
    segments, stitches = strict(done.folder / "segments.json"), strict(done.folder / "stitches.json")
    metrics = strict(done.folder / "metrics.json")["metrics"]
    values = {(m["method"], m["metric"]): m["value"] for m in metrics}
    assert set(segments) == {"htms", "slamstitch"}
    for method, found in segments.items():
        tried = stitches.get(method, [])
        assert all(0 <= s["start"] < s["stop"] <= scans for s in found)
        assert values[method, "segments"] == len(found)
        assert values[method, "stitches_tried"] == len(tried)
        assert values[method, "stitches_accepted"] == sum(s["accepted"] for s in tried)
        assert values[method, "stitches_false"] == sum(s.get("false", False) for s in tried)
        for stitch in tried:
            assert 0 <= stitch["a"] < stitch["b"] < len(found)
            assert ("T_a_b" in stitch) != ("reason" in stitch)
            assert ("error_m" in stitch) == ("T_a_b" in stitch)


def test_trajectories_maps_and_graphs_are_read_by_our_own_readers(done, scans):
    recording = load(done.folder / "recording.npz")
    for name in [*METHODS, "truth"]:
        time, poses = tum.read(done.folder / "trajectories" / f"{name}.tum")
        np.testing.assert_array_equal(time, recording.time)
        assert poses.shape == (scans, 3)
        grid = ros_map.read(done.folder / "maps" / f"{name}.yaml")
        assert grid.resolution == 0.05
        assert grid.occupied.sum() > 100
        assert grid.free.sum() > grid.occupied.sum()
    before = g2o.read(done.folder / "posegraphs" / "slamstitch-before.g2o")
    after = g2o.read(done.folder / "posegraphs" / "slamstitch-after.g2o")
    np.testing.assert_array_equal(before.edges, after.edges)
    assert before.poses.shape == after.poses.shape


def test_map_pictures_show_what_the_ros_map_says(done):
    import cv2

    picture = cv2.imread(str(done.folder / "maps" / "slamstitch.png"), cv2.IMREAD_GRAYSCALE)
    grid = ros_map.read(done.folder / "maps" / "slamstitch.yaml")
    np.testing.assert_array_equal(picture[::-1] == 0, grid.occupied)
    np.testing.assert_array_equal(picture[::-1] == 255, grid.free)


def test_the_page_carries_its_figures_and_the_command(done):
    page = (done.folder / "report.html").read_text()
    figures = page[page.index('id="figures"') : page.index('id="run"')]
    assert figures.count("data:image/png;base64,") == len(list(done.folder.glob("figures/*.png")))
    assert "python -m scenarios.run" in page
    assert not re.search(r"<(img|script|link)[^>]*(src|href)=\"(?!data:)", page)


@pytest.mark.usefixtures("no_figures")
def test_latest_is_a_relative_link_to_the_last_run(command, drive, tmp_path):
    other = tmp_path / "other.npz"
    other.write_bytes(drive.read_bytes())
    out = tmp_path / "runs"
    for log, expected in ((drive, "drive-seed0"), (other, "other-seed0"), (drive, "drive-seed0")):
        assert command(log, "--methods", "ins", "--out", out).code == 0
        assert (out / "latest").readlink() == Path(expected)
    assert sorted(path.name for path in out.iterdir()) == ["drive-seed0", "latest", "other-seed0"]


@pytest.mark.usefixtures("no_figures")
def test_a_run_replaces_the_one_before_it(command, drive, tmp_path):
    for methods in ("ins", "ins,wsm", "wsm"):
        assert command(drive, "--methods", methods, "--out", tmp_path).code == 0
        names = {path.stem for path in (tmp_path / "drive-seed0" / "trajectories").iterdir()}
        assert names == {*methods.split(","), "truth"}


@pytest.mark.usefixtures("no_figures")
def test_a_folder_somebody_calls_latest_stays(command, drive, tmp_path):
    (tmp_path / "latest").mkdir()
    assert command(drive, "--methods", "ins", "--out", tmp_path).code == 0
    assert list((tmp_path / "latest").iterdir()) == []
    assert not (tmp_path / "latest").is_symlink()


@pytest.mark.usefixtures("no_figures")
@pytest.mark.parametrize("fault", [RuntimeError, KeyboardInterrupt])
@pytest.mark.parametrize("stage", ["method", "writing"])
def test_a_run_that_dies_leaves_nothing_and_the_one_before_it(
    fault, stage, command, drive, tmp_path, monkeypatch
):
    from scenarios import methods
    from scenarios.run_folder import write

    def die(*_):
        raise fault

    def attempt(out):
        if fault is RuntimeError:
            with pytest.raises(RuntimeError):
                command(drive, "--methods", "ins", "--out", out)
        else:
            finished = command(drive, "--methods", "ins", "--out", out)
            assert finished.code == 130
            assert finished.stderr.endswith("scenarios.run: interrupted\n")

    assert command(drive, "--methods", "ins", "--out", tmp_path / "old").code == 0
    kept = {path: path.stat().st_mtime_ns for path in (tmp_path / "old").rglob("*")}
    if stage == "method":
        monkeypatch.setitem(methods.METHODS, "ins", methods.Method("ins", die))
    else:
        monkeypatch.setattr(write, "write_submaps", die)
    attempt(tmp_path / "new" / "runs")
    attempt(tmp_path / "old")
    assert not (tmp_path / "new").exists()
    assert {path: path.stat().st_mtime_ns for path in (tmp_path / "old").rglob("*")} == kept
