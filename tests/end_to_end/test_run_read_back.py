"""A run's folder can be read back, drawn again, and opened in a viewer."""

from __future__ import annotations

import importlib.util
import json
import sys

import numpy as np
import pytest

from scenarios.report import __main__ as report
from scenarios.report import album, stitching, view
from scenarios.run_folder.reading import read
from slam.cli import InputError
from slam.formats import load


def test_what_was_written_is_read(done, drive):
    recording, estimates, metrics = read(done.folder)
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


def test_submaps_are_cut_again_where_they_were(done):
    _, estimates, _ = read(done.folder)
    for estimate in estimates:
        for submap in estimate.submaps:
            np.testing.assert_allclose(submap.anchor, estimate.track.poses[submap.start])
            assert len(submap.grid.occupied_points()) > 10


def test_the_album_has_a_figure_of_every_stitch(done, tmp_path, monkeypatch):
    drawn = []
    monkeypatch.setattr(album, "write", lambda into, plates: drawn.extend((into, p.name) for p in plates))
    monkeypatch.setattr(album.Drawing, "plate", lambda drawing: drawing)
    assert album.run([done.folder], tmp_path) == str(tmp_path / "drive-seed0")
    _, estimates, _ = read(done.folder)
    stitches = {
        f"stitch-{e.method}-{t.a}-{t.b}" for e in estimates for t in e.stitches if stitching.drawable(e, t)
    }
    names = [name for _, name in drawn]
    assert len(names) == len(set(names))
    assert stitches | {"maps", "trajectories"} <= set(names)
    assert {into for into, _ in drawn} == {tmp_path / "drive-seed0"}


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
        read(tmp_path)
