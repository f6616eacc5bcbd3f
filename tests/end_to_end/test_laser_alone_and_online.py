"""Two ways to run: scan by scan, and without dead reckoning."""

from __future__ import annotations

import json
import re
from dataclasses import replace

import numpy as np
import pytest

from slam.formats import load, recording_npz


def metrics_of(folder, method):
    entries = json.loads((folder / "metrics.json").read_text())["metrics"]
    return {m["metric"]: m for m in entries if m["method"] == method}


@pytest.mark.usefixtures("no_figures")
def test_online_reports_latency_and_both_errors(command, drive, tmp_path):
    finished = command(drive, "--methods", "ins", "--online", "--out", tmp_path)
    assert finished.code == 0
    found = metrics_of(tmp_path / "drive-seed0", "slamstitch_online")
    assert (
        0.0
        < found["latency_median"]["value"]
        <= found["latency_p99"]["value"]
        <= found["latency_max"]["value"]
    )
    assert found["latency_max"]["unit"] == "ms"
    assert found["ate_online"]["value"] < 0.2
    assert found["ate_rmse"]["value"] < 0.2
    assert re.search(r"^ +latency_p99 ↓ +ms +– +\d", finished.stdout, re.MULTILINE)
    assert metrics_of(tmp_path / "drive-seed0", "ins")["latency_max"]["value"] is None


@pytest.mark.usefixtures("no_figures")
def test_without_dead_reckoning_methods_that_need_it_say_so(command, drive, tmp_path):
    finished = command(drive, "--methods", "ins,wsm,icp", "--no-dead-reckoning", "--out", tmp_path)
    assert finished.code == 0
    folder = tmp_path / "drive-seed0"
    assert metrics_of(folder, "ins")["ate_rmse"] == {
        "method": "ins",
        "metric": "ate_rmse",
        "value": None,
        "unit": "m",
        "better": "lower",
        "reason": "the recording has no dead reckoning",
    }
    assert metrics_of(folder, "wsm")["wall_s"]["value"] is None
    assert metrics_of(folder, "icp")["ate_rmse"]["value"] is not None
    assert "no dead reckoning (--no-dead-reckoning): the laser alone tells" in finished.stderr
    assert load(folder / "recording.npz").source == "none"
    assert not (folder / "trajectories" / "ins.tum").exists()
    assert "the recording has no dead reckoning" in (folder / "report.html").read_text()


def test_a_drive_that_cannot_be_followed_is_refused(command, drive, tmp_path):
    recording = load(drive).without_dead_reckoning()
    ranges = recording.ranges.copy()
    ranges[20:] = np.nan
    recording_npz.write(tmp_path / "lost.npz", replace(recording, ranges=ranges))
    finished = command(tmp_path / "lost.npz", "--methods", "ins,icp", "--out", tmp_path / "runs")
    assert finished.code == 2
    assert finished.stdout == ""
    assert re.search(r"ins: the recording has no.*; icp: \d+% of the scans could be matched", finished.stderr)
    assert not (tmp_path / "runs").exists()
