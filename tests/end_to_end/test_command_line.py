"""What the command says: help, lists, tables."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

CHECKOUT = Path(__file__).resolve().parents[2]
SLOW = {"numba", "gtsam", "cv2", "matplotlib", "scipy", "pymunk", "dask", "numpy", "rich.table"}


def python(*words: str, env: dict[str, str] | None = None) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, *words]
    return subprocess.run(command, cwd=CHECKOUT, capture_output=True, text=True, check=False, env=env)


def test_help_and_list_load_nothing_slow():
    code = (
        "import sys; sys.argv = ['run.py', '--list']; import scenarios.run as r;"
        "r.main(r.Options, r.COMMAND, r.run); print(*sys.modules, file=sys.stderr)"
    )
    finished = python("-c", code)
    assert finished.returncode == 0
    assert set(finished.stderr.split()) & SLOW == set()


def test_the_list_names_every_scenario(command):
    from scenarios.catalogue import CATALOGUE

    finished = command("--list")
    assert (finished.code, finished.stderr) == (0, "")
    assert [line.split()[0] for line in finished.stdout.splitlines()] == list(CATALOGUE)


def test_help_names_every_option():
    finished = python("-m", "scenarios.run", "--help")
    assert (finished.returncode, finished.stderr) == (0, "")
    for option in (
        "NAME|LOG", "--list", "--seed K", "--methods A,B,…", "--out DIR", "--format {table,json}",
        "--relations FILE", "--laser-mount X Y YAW", "--topic TOPIC", "--odometry TOPIC",
    ):  # fmt: skip
        assert option in finished.stdout
    assert "--no-list" not in finished.stdout
    assert "None" not in finished.stdout


def test_bad_input_from_the_shell_is_one_line_and_exit_code_2(tmp_path):
    finished = python("-m", "scenarios.run", "hospitl", "--out", str(tmp_path / "runs"))
    assert finished.returncode == 2
    assert finished.stdout == ""
    assert finished.stderr == "scenarios.run: unknown scenario 'hospitl': did you mean 'hospital'?\n"
    assert list(tmp_path.iterdir()) == []


def test_a_terminal_without_arrows_and_umlauts_gets_question_marks():
    environment = os.environ | {"PYTHONIOENCODING": "ascii"}
    finished = python("-m", "scenarios.run", "--help", env=environment)
    assert (finished.returncode, finished.stderr) == (0, "")
    assert "K?mmerle" in finished.stdout


def test_a_reader_that_leaves_early_is_no_bug():
    reading, writing = os.pipe()
    os.close(reading)
    command = [sys.executable, "-m", "scenarios.run", "--list"]
    finished = subprocess.run(command, cwd=CHECKOUT, stdout=writing, stderr=subprocess.PIPE, check=False)
    os.close(writing)
    assert (finished.returncode, finished.stderr) == (141, b"")


def test_the_table_shows_every_number_whole(done):
    table = done.finished.stdout
    metrics = json.loads((done.folder / "metrics.json").read_text())["metrics"]
    assert done.finished.code == 0
    assert "…" not in table
    assert re.search(r"metric +unit +ins +icp +wsm +htms +slamstitch", table)
    for name in {m["metric"] for m in metrics if m["value"] is not None}:
        (row,) = re.findall(rf"^ +{name} [ ↓↑].*$", table, re.MULTILINE)
        assert len(re.findall(r"(?<=\s)(–|-?\d+(\.\d+)?)(?=\s|$)", row)) == 5
    assert table.splitlines()[-1] == str(done.folder / "report.html")


def test_what_no_method_has_is_told_once_with_the_reason(done):
    table = " ".join(done.finished.stdout.split())
    assert table.count("relation_clear_trans_mean") == 1
    assert "relation_clear_rot_std: relations made from truth have no ambiguous stamps" in table


def test_progress_goes_to_stderr(done):
    for stage in ("read", "ins", "icp", "wsm", "htms", "slamstitch", "evaluate", "report"):
        assert re.search(rf"^{stage} +\d+\.\d s$", done.finished.stderr, re.MULTILINE)


@pytest.mark.usefixtures("no_figures")
def test_json_on_stdout_is_the_metrics_file_and_nothing_else(command, drive, tmp_path):
    finished = command(drive, "--methods", "ins", "--format", "json", "--out", tmp_path)
    assert finished.code == 0
    assert finished.stdout == (tmp_path / "drive-seed0" / "metrics.json").read_text()
    assert {m["method"] for m in json.loads(finished.stdout)["metrics"]} == {"ins"}


@pytest.mark.usefixtures("no_figures")
@pytest.mark.parametrize("mount", [("-0.04", "0", "0.1"), ("0", "-1e-2", "-3")])
def test_a_laser_mount_may_come_before_or_after_the_log(mount, command, drive, tmp_path):
    from slam.formats import load

    before = command("--laser-mount", *mount, drive, "--methods", "ins", "--out", tmp_path / "a")
    after = command(drive, "--methods=ins", f"--out={tmp_path / 'b'}", "--laser-mount", *mount)
    assert before.code == after.code == 0
    for out in ("a", "b"):
        laser = load(tmp_path / out / "latest" / "recording.npz").laser
        assert laser.T_robot_laser.tolist() == [float(word) for word in mount]


@pytest.mark.usefixtures("no_figures")
def test_one_line_says_what_of_a_bag_was_taken(command, drive, tmp_path):
    pytest.importorskip("rosbags")
    from slam.formats import load
    from slam.formats.rosbag import writer

    recording = load(drive)
    writer.write(tmp_path / "bag", recording)
    finished = command(tmp_path / "bag", "--methods", "ins", "--out", tmp_path / "runs")
    assert finished.code == 0
    (line,) = (line for line in finished.stderr.splitlines() if line.startswith("took "))
    x, y, _ = recording.laser.T_robot_laser
    for part in (
        f"laser /scan, {len(recording.angles)} beams over ",
        f"mount x {x:.3f} m, y {y:.3f} m, yaw ",
        "(/tf_static); odometry /",
        f"; {len(recording)} scans, none dropped",
    ):
        assert part in line
    refused = command(tmp_path / "bag", "--topic", "/rear", "--out", tmp_path / "runs")
    assert (refused.code, refused.stderr.count("\n")) == (2, 1)
    assert "no laser '/rear', expected one of those in the bag: /scan" in refused.stderr
    assert command("hospital", "--topic", "/rear", "--out", tmp_path / "runs").code == 2
