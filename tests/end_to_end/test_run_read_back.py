"""A run's folder can be read back, drawn again, and opened in a viewer."""

from __future__ import annotations

import importlib.util
import json
import sys
from dataclasses import replace

import numpy as np
import pytest

from scenarios.methods import METHODS
from scenarios.methods.config import MethodConfig
from scenarios.report import __main__ as report
from scenarios.report import figures, view
from scenarios.report.stitches import AlignedPair
from scenarios.run_folder.arrays import write_submaps
from scenarios.run_folder.read import read_run
from slam.cli import InputError
from slam.formats import load


def test_what_was_written_is_read_run(done, drive):
    recording, estimates, metrics = read_run(done.folder)
    np.testing.assert_array_equal(recording.ranges, load(drive).ranges)
    told = json.loads((done.folder / "metrics.json").read_text())
    assert [metric.to_json() for metric in metrics] == told["metrics"]
    assert [estimate.method for estimate in estimates] == ["ins", "icp", "wsm", "htms", "slamstitch"]
    stories = json.loads((done.folder / "stitches.json").read_text())
    segments = json.loads((done.folder / "segments.json").read_text())
    for estimate in estimates:
        method = estimate.method
        assert estimate.poses.shape == (len(recording), 3)
        assert (estimate.track is None) == (method == "ins")
        assert (estimate.covariance is None) == (method != "slamstitch")
        assert (estimate.graph_after is None) == (method != "slamstitch")
        spans = [{"start": submap.start, "stop": submap.stop} for submap in estimate.submaps]
        assert spans == segments.get(method, [])
        accepted = [tried.accepted for tried in estimate.stitches]
        assert accepted == [story["accepted"] for story in stories.get(method, [])]


def arrays_of(submap):
    """Every array of a submap, of its points and of its grid."""
    parts = vars(submap) | {f"points.{k}": v for k, v in vars(submap.points).items()}
    parts |= {f"grid.{k}": v for k, v in vars(submap.grid).items()}
    return {k: v for k, v in parts.items() if k not in ("points", "grid")}


@pytest.mark.parametrize("method", ["htms", "slamstitch", "slamstitch_online"])
def test_submaps_are_read_back_as_they_were_in_memory(method, done, drive, tmp_path):
    estimate = METHODS[method](load(drive), MethodConfig())
    assert len(estimate.submaps) >= 1
    folder = done.folder
    if method == "slamstitch_online":  # the run of the fixture is offline
        folder = tmp_path
        for path in done.folder.iterdir():
            (folder / path.name).symlink_to(path)
        (folder / "submaps.npz").unlink()
        write_submaps(folder / "submaps.npz", [replace(estimate, method="slamstitch")], load(drive))
        method = "slamstitch"
    _, estimates, _ = read_run(folder)
    (read,) = (e.submaps for e in estimates if e.method == method)
    assert len(read) == len(estimate.submaps)
    for stored, submap in zip(read, estimate.submaps, strict=True):
        expected = arrays_of(submap)
        for name, value in arrays_of(stored).items():
            assert np.asarray(value).dtype == np.asarray(expected[name]).dtype, name
            np.testing.assert_array_equal(value, expected[name], err_msg=name)


def test_a_run_without_stored_submaps_is_refused_but_can_be_compared(done, tmp_path, monkeypatch, capsys):
    for path in done.folder.iterdir():
        if path.name != "submaps.npz":
            (tmp_path / path.name).symlink_to(path)
    monkeypatch.setattr(sys, "argv", ["report", "album", str(tmp_path)])
    assert report.main(report.Options, report.COMMAND, report.run) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert f"{tmp_path}: a run of an older version, without submaps.npz: make it again" in line
    monkeypatch.setattr(sys, "argv", ["report", str(tmp_path)])
    assert report.main(report.Options, report.COMMAND, report.run) == 0
    assert "ate_rmse" in capsys.readouterr().out


def test_the_album_has_a_figure_of_every_stitch(done, tmp_path, monkeypatch):
    drawn = []
    monkeypatch.setattr(
        figures, "write_figures", lambda folder, some: drawn.extend((folder, f.name) for f in some)
    )
    assert figures.run([done.folder], tmp_path) == str(tmp_path / "drive-seed0")
    _, estimates, _ = read_run(done.folder)
    stitches = {
        f"stitch-{e.method}-{s.a}-{s.b}"
        for e in estimates
        for s in e.stitches
        if AlignedPair.of(e, s).complete
    }
    names = [name for _, name in drawn]
    assert len(names) == len(set(names))
    assert stitches | {"maps", "trajectories"} <= set(names)
    assert {folder for folder, _ in drawn} == {tmp_path / "drive-seed0"}


def test_a_run_opens_in_rerun(done, tmp_path):
    pytest.importorskip("rerun", reason="rerun-sdk is not installed")
    out = tmp_path / "new" / "run.rrd"
    assert view.run([done.folder], out) == str(out)
    assert out.read_bytes()[:3] == b"RRF"
    assert out.stat().st_size > 100_000


def test_without_rerun_it_says_how_to_install_it(done, monkeypatch, capsys):
    found = importlib.util.find_spec
    monkeypatch.setattr(view, "find_spec", lambda name: None if name == "rerun" else found(name))
    monkeypatch.setattr(sys, "argv", ["report", "view", str(done.folder)])
    assert report.main(report.Options, report.COMMAND, report.run) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("scenarios.report: Rerun is not installed: pip install -e '.[view]'")


def test_a_run_that_is_to_be_viewed_asks_for_rerun_before_it_begins(command, drive, tmp_path, monkeypatch):
    monkeypatch.setattr(view, "find_spec", lambda name: None)
    finished = command(drive, "--methods", "ins", "--view", "--out", tmp_path / "runs")
    assert finished.code == 2
    assert "pip install" in finished.stderr
    assert not (tmp_path / "runs").exists()


def test_a_run_is_viewed_when_it_is_done(command, drive, tmp_path, monkeypatch):
    seen = []
    monkeypatch.setattr(view, "check", lambda: None)
    monkeypatch.setattr(view, "run", lambda folders, out: seen.append((folders, out)))
    assert command(drive, "--methods", "ins", "--view", "--out", tmp_path).code == 0
    assert seen == [([tmp_path / "drive-seed0"], None)]


@pytest.mark.parametrize(
    ("name", "content", "complaint"),
    [
        (None, None, "expected the folder of a run, with metrics.json"),
        ("stitches.json", "[", "stitches.json: expected JSON of a run"),
        ("tracks.npz", "", "cannot be read as a run"),
        ("submaps.npz", "", "cannot be read as a run"),
        ("recording.npz", "", "cannot be read as a run"),
    ],
)
def test_a_damaged_folder_is_bad_input(name, content, complaint, done, tmp_path):
    if name is not None:
        for path in done.folder.iterdir():
            (tmp_path / path.name).symlink_to(path)
        (tmp_path / name).unlink()
        (tmp_path / name).write_text(content)
    with pytest.raises(InputError, match=complaint):
        read_run(tmp_path)
