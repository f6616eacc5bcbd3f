"""Exporting simulated recordings: other systems get the same drive, and relations that leave no doubt."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from scenarios import export
from scenarios.evaluation.relations import clear_relations, relation_metrics, relation_pairs
from sim.floorplan import wall
from sim.record import Setup, simulate
from sim.terrain import Terrain
from sim.world import World
from slam import se2
from slam.formats import load, recording_npz
from slam.recording import Odometry, Recording


class Room:
    """A room of 6 × 5 m, driven round twice."""

    name = "room"

    def build(self, rng: np.random.Generator) -> Setup:
        corners = [[0, 0], [6, 0], [6, 5], [0, 5], [0, 0]]
        walls = [piece for a, b in pairwise(corners) for piece in wall(a, b)]
        round_once = [[1.5, 1.5], [4.5, 1.5], [4.5, 3.5], [1.5, 3.5]]
        route = np.array([*round_once, *round_once, [1.5, 1.5]])
        return Setup(World(tuple(walls), Terrain.level([0, 0], [6, 5]), 2.5), (1.5, 1.5, 0.0), route)


@pytest.fixture(scope="module")
def drive() -> Recording:
    return simulate(Room(), 1).recording


@pytest.fixture
def file(drive: Recording, tmp_path: Path) -> Path:
    recording_npz.write(tmp_path / "room.npz", drive)
    return tmp_path / "room.npz"


def exported(file: Path, form: export.Format) -> Recording:
    out = file.parent / "room.log"
    export.run(export.Options(str(file), form, out))
    return load(out)


@pytest.mark.parametrize("form", ["usarsim", "carmen", "rosbag"])
def test_a_simulated_recording_comes_back(
    form: export.Format, file: Path, drive: Recording, capsys: pytest.CaptureFixture[str]
) -> None:
    if form == "rosbag":
        pytest.importorskip("rosbags", reason="ROS 2 bags need rosbags: pip install 'slamstitch[ros]'")
    found = exported(file, form)
    assert capsys.readouterr().out.splitlines()[0] == str(file.parent / "room.log")
    np.testing.assert_allclose(found.time, drive.time, atol=1e-6)
    np.testing.assert_array_equal(np.isnan(found.ranges), np.isnan(drive.ranges))
    np.testing.assert_allclose(found.ranges, drive.ranges, atol=0.005)
    np.testing.assert_allclose(found.angles, drive.angles, atol=1e-6)
    assert found.source == drive.source
    for name in ("truth", "dead_reckoning"):
        error = se2.between(getattr(drive, name), getattr(found, name))
        np.testing.assert_allclose(error, 0.0, atol=2e-6, err_msg=name)
    np.testing.assert_allclose(found.attitude, drive.attitude, atol=5e-6)
    np.testing.assert_allclose(found.laser.T_robot_laser, drive.laser.T_robot_laser, atol=1e-5)


def test_relations_of_a_carmen_log_are_true_and_clear(file: Path, drive: Recording) -> None:
    recording_npz.write(file, drive.with_laser_mount(np.array([0.3, -0.1, 0.2])))
    exported(file, "carmen")
    found = load(file.parent / "room.log", file.parent / "room.relations")
    pairs = relation_pairs(found)
    assert pairs is not None
    assert len(pairs.clear) > 1.5 * len(drive)  # every step, and revisits
    assert np.all(pairs.clear)
    assert drive.truth is not None
    truth = relation_metrics(drive.truth, found, pairs)
    assert truth["relation_trans_mean"] == pytest.approx(0.0, abs=1e-5)
    assert truth["relation_clear_rot_mean"] == pytest.approx(0.0, abs=1e-4)
    ins = relation_metrics(drive.dead_reckoning, found, pairs)
    assert float(ins["relation_trans_mean"]) > 1e-4


def test_relations_with_ambiguous_stamps_are_left_out(drive: Recording) -> None:
    whole = clear_relations(drive)
    assert whole is not None
    time = drive.time.copy()
    time[4] = time[5] + 0.004
    found = clear_relations(replace(drive, time=time))
    assert found is not None
    assert len(found.stamps) < len(whole.stamps)
    assert not np.isin(time[4:6], found.stamps).any()
    rate = np.concatenate([drive.time, drive.time[[7]] + 0.006])
    poses = np.concatenate([drive.dead_reckoning, drive.dead_reckoning[[7]]])
    full = replace(drive, odometry=Odometry(rate, poses, np.arange(len(drive))))
    found = clear_relations(full)
    assert found is not None
    assert drive.time[7] not in found.stamps
    assert drive.time[8] in found.stamps
    assert clear_relations(replace(drive, truth=None)) is None


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["hospitl", "--format", "carmen", "-o", "a.log"], "unknown scenario 'hospitl': did you mean"),
        (["nowhere.log", "--format", "carmen", "-o", "a.log"], "nowhere.log: no such file"),
        (["room.npz", "--format", "bag", "-o", "a.log"], "invalid choice 'bag'"),
        (["room.npz", "--format", "carmen", "-o", "no/a.log"], "no: no such folder"),
        (["room.npz", "--format", "carmen", "-o", "room.npz"], "room.npz: exists already"),
        (["room.npz", "--format", "rosbag", "-o", "."], "exists already"),
        (["room.npz", "--format", "carmen", "-o", "a.log", "--seed", "-1"], "--seed: expected 0 or more"),
        (["uneven.npz", "--format", "carmen", "-o", "a.log"], "evenly spaced"),
    ],
)
def test_bad_input_is_one_line_and_exit_code_2(
    arguments: list[str],
    message: str,
    file: Path,
    drive: Recording,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    from slam.cli import main

    angles = np.sort(np.random.default_rng(0).uniform(-2, 2, len(drive.angles)))
    recording_npz.write(file.parent / "uneven.npz", replace(drive, angles=angles))
    monkeypatch.chdir(file.parent)
    monkeypatch.setattr("sys.argv", ["export", *arguments])
    assert main(export.Options, export.COMMAND, export.run) == 2
    complaint = capsys.readouterr().err
    assert message in complaint
    assert complaint.count("\n") == 1
    assert sorted(p.name for p in file.parent.iterdir()) == ["room.npz", "uneven.npz"]


@pytest.mark.parametrize("form", ["usarsim", "carmen", "rosbag"])
def test_a_spoilt_recording_is_written_as_the_methods_see_it(
    form: export.Format, file: Path, drive: Recording
) -> None:
    """Not as the full-rate odometry has it, by which it is scored."""
    if form == "rosbag":
        pytest.importorskip("rosbags", reason="ROS 2 bags need rosbags: pip install 'slamstitch[ros]'")
    rows = np.arange(len(drive))
    time = np.repeat(drive.time, 2) - np.tile([0.01, 0.0], len(drive))
    full_rate = Odometry(time, np.repeat(drive.dead_reckoning, 2, axis=0), 2 * rows + 1)
    recording_npz.write(file, replace(drive, odometry=full_rate))
    out = file.parent / "room.log"
    export.run(export.Options(str(file), form, out, corrupt=("odometry.late=5",)))
    late = drive.dead_reckoning[np.maximum(rows - 5, 0)]
    np.testing.assert_allclose(se2.between(late, load(out).dead_reckoning), 0.0, atol=2e-6)
