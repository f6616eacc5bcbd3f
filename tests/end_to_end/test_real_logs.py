"""Real robots' logs."""

from __future__ import annotations

import json

import pytest


def value(folder, method, metric):
    metrics = json.loads((folder / "metrics.json").read_text())["metrics"]
    (found,) = (m for m in metrics if (m["method"], m["metric"]) == (method, metric))
    return found["value"]


@pytest.mark.usefixtures("no_figures")
def test_usarsim_dead_reckoning_of_iran_open_2012(command, shared_data, tmp_path):
    log = shared_data / "usarsim" / "iro2012-pre2" / "Robot1.log"
    assert command(log, "--methods", "ins", "--out", tmp_path).code == 0
    assert value(tmp_path / "Robot1-seed0", "ins", "ate_rmse") == pytest.approx(0.051, abs=0.005)


@pytest.mark.usefixtures("no_figures")
def test_carmen_intel_beside_what_gmapping_published(command, shared_data, tmp_path):
    """With the laser on the wheels' middle, where the log puts it, as those did who published figures."""
    carmen = shared_data / "carmen"
    finished = command(
        carmen / "intel.raw.log.gz", "--relations", carmen / "intel.relations", "--methods", "ins",
        "--laser-mount", "0", "0", "0", "--out", tmp_path,
    )  # fmt: skip
    assert finished.code == 0
    assert "(published)" in finished.stdout
    assert "laser mount" not in finished.stderr
    folder = tmp_path / "intel-seed0"
    assert value(folder, "ins", "relation_trans_mean") == pytest.approx(7.383, abs=1e-3)
    assert value(folder, "gmapping (published)", "relation_trans_mean") == pytest.approx(0.0447, abs=1e-4)
    assert value(folder, "gmapping (published)", "relation_clear_trans_mean") == pytest.approx(
        0.0278, abs=1e-4
    )
    assert (folder / "maps" / "gmapping_published.pgm").is_file()


@pytest.mark.usefixtures("no_figures")
def test_carmen_intel_with_its_laser_where_the_drive_says_it_is(command, shared_data, tmp_path):
    carmen = shared_data / "carmen"
    finished = command(
        carmen / "intel.raw.log.gz", "--relations", carmen / "intel.relations", "--methods", "slamstitch",
        "--out", tmp_path,
    )  # fmt: skip
    assert finished.code == 0
    assert "laser mount, estimated from the drive: x 0.0" in finished.stderr
    folder = tmp_path / "intel-seed0"
    assert value(folder, "gmapping (published)", "relation_trans_mean") == pytest.approx(0.0436, abs=5e-4)
    assert value(folder, "slamstitch", "relation_trans_mean") < 0.039
    assert value(folder, "slamstitch", "relation_clear_trans_mean") < 0.020
