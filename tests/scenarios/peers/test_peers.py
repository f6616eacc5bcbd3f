"""Systems of others: run apart, blind and within limits; what is not here is skipped and never a failure."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from scenarios.peers import PEERS, Peer, mrpt, process
from scenarios.peers import __main__ as command
from scenarios.peers.process import Limits, Solved, solve
from scenarios.peers.worker import POSES, RECORDING, work
from slam import se2
from slam.cli import main
from slam.formats import recording_npz
from slam.recording import Recording
from slam.se2 import Array

LIMITS = Limits(60.0, 8.0)


@pytest.fixture(scope="session")
def drive(record: Callable[..., Recording], room: Array, curve: Callable[..., Array]) -> Recording:
    """A turn in the room in small steps, with odometry that drifts."""
    truth = curve(60)
    steps = se2.between(truth[:-1], truth[1:]) * [1.03, 1.0, 1.02]
    reckoned = [truth[0]]
    for step in steps:
        reckoned.append(se2.compose(reckoned[-1], step))
    recording = record(room, truth, dead_reckoning=np.array(reckoned))
    return recording.with_laser_mount(np.zeros(3))


def toy(solve: str, installed: bool = True) -> Peer:
    return Peer(
        "toy", "a toy", f"{__name__}:{solve}", lambda: installed, "pip install toy", lambda: "1.2", ""
    )


def reckon(recording: Recording, settings: str, folder: Path) -> Array:
    assert recording.truth is None
    assert recording.relations is None
    assert folder.is_dir()
    return recording.dead_reckoning if settings == "default" else recording.dead_reckoning[::-1]


def in_this_process(monkeypatch: pytest.MonkeyPatch, peer: Peer) -> None:
    """A toy that is run here: a process of its own would have to import what it is in."""

    def here(peer: Peer, recording: Recording, settings: str, limits: Limits) -> Solved:
        from slam.trajectory import Trajectory

        poses = reckon(replace(recording, truth=None), settings, Path())
        return Solved(Trajectory(recording.time, poses, body="robot"), 1.5, 20.0)

    monkeypatch.setitem(PEERS, "toy", peer)
    monkeypatch.setattr(process, "solve", here)


def call(monkeypatch: pytest.MonkeyPatch, *words: str) -> int:
    monkeypatch.setattr("sys.argv", ["peers", *words])
    return main(command.Options, command.COMMAND, command.run)


def test_a_peer_stands_in_the_table_with_its_cost_and_version(
    drive: Recording, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("scenarios.report.page.run_specs", lambda *_: [])
    in_this_process(monkeypatch, toy("reckon"))
    recording_npz.write("room.npz", drive)
    words = ("run", "toy", "room.npz", "--methods", "ins", "--settings", "both", "--format", "json")
    assert call(monkeypatch, *words) == 0
    metrics = json.loads(capsys.readouterr().out)["metrics"]
    found = {(m["method"], m["metric"]): m["value"] for m in metrics}
    assert found["toy", "ate_rmse"] == pytest.approx(found["ins", "ate_rmse"])
    assert found["toy (tuned)", "ate_rmse"] > 2.0 * found["toy", "ate_rmse"]
    assert found["toy", "wall_s"] == 1.5
    folder = Path("runs/latest")
    assert json.loads((folder / "environment.json").read_text())["peers"] == {
        "toy": "1.2",
        "toy (tuned)": "1.2",
    }
    assert "scenarios.peers run toy" in json.loads((folder / "config.json").read_text())["command"]


def test_what_is_not_installed_is_skipped_in_one_line(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setitem(PEERS, "toy", toy("reckon", installed=False))
    assert call(monkeypatch, "run", "toy", "hospital") == 0
    told = capsys.readouterr()
    assert told.err == "toy is not installed, skipped: pip install toy\n"
    assert call(monkeypatch, "list") == 0
    assert "toy                not installed  a toy" in capsys.readouterr().out
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("run", "mrpt"), "unknown peer 'mrpt'"),
        (("run",), "expected a name, one of mrpt-icp-slam"),
        (("run", "all"), "expected a recording"),
        (("run", "all", "hospital", "--seconds", "0"), "expected more than 0"),
        (("jump",), "invalid choice 'jump'"),
    ],
)
def test_bad_input_is_one_line(
    words: tuple[str, ...], message: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert call(monkeypatch, *words) == 2
    complaint = capsys.readouterr().err
    assert message in complaint
    assert complaint.count("\n") == 1


def test_a_process_that_takes_too_long_or_fails_is_ended_and_told(
    drive: Recording, monkeypatch: pytest.MonkeyPatch
) -> None:
    started = time.perf_counter()
    slow = solve(PEERS["mrpt-icp-slam"], drive, "default", Limits(0.05, 8.0))
    assert slow == "took more than 0.05 s"
    assert time.perf_counter() - started < 5.0
    broken = replace(PEERS["mrpt-icp-slam"], name="no such peer")
    assert "ended with code 1: KeyError: 'no such peer'" in str(solve(broken, drive, "default", LIMITS))


def test_a_worker_is_told_no_truth_and_writes_poses(
    drive: Recording, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(PEERS, "toy", toy("reckon"))
    recording_npz.write(tmp_path / RECORDING, replace(drive, truth=None))
    work(["toy", "default", str(tmp_path)])
    with np.load(tmp_path / POSES) as arrays:
        np.testing.assert_array_equal(arrays["poses"], drive.dead_reckoning)
        assert arrays["wall_s"] >= 0.0
        assert arrays["peak_mb"] > 10.0


@pytest.mark.parametrize("name", PEERS)
def test_a_peer_that_is_here_follows_an_easy_drive(name: str, drive: Recording, tmp_path: Path) -> None:
    """The turn of 2 rad in a room full of corners, with the laser off the robot's middle."""
    if not PEERS[name].installed():
        pytest.skip(f"{name} is not installed: {PEERS[name].install}")
    from importlib import import_module

    module, _, function = PEERS[name].solve.partition(":")
    assert drive.truth is not None
    poses = getattr(import_module(module), function)(drive, "tuned", tmp_path)
    assert poses.shape == drive.truth.shape
    moved = se2.between(se2.between(drive.truth[0], drive.truth), se2.between(poses[0], poses))
    assert np.hypot(moved[-1, 0], moved[-1, 1]) < 0.25
    assert abs(moved[-1, 2]) < 0.15


def test_settings_are_mrpt_s_own_and_tuned_ones_differ() -> None:
    assert "ICP_algorithm = icpClassic\n" in mrpt.ini("default")
    assert "ICP_algorithm = icpLevenbergMarquardt\n" in mrpt.ini("tuned")
    assert mrpt.ini("default").count("[") == 3
