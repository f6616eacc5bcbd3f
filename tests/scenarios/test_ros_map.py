"""``python -m scenarios.run my_map.yaml``: somebody's own building, driven through."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from scenarios.catalogue.ros_map import MappedBuilding
from scenarios.run import COMMAND, Options, checked, run
from scenarios.source import simulated
from sim.record import simulate
from slam import se2
from slam.cli import InputError, Pose, main, parse
from slam.formats import ros_map
from slam.mapping.occupancy import Grid

RESOLUTION, ORIGIN = 0.05, np.array([-2.0, 1.0])


def flat() -> Grid:
    """Two rooms of 4 × 4 m with a door of 1 m, unknown outside."""
    occupied = np.zeros((90, 170), dtype=bool)
    occupied[[4, 85], 4:166] = True
    occupied[4:86, [4, 85, 165]] = True
    occupied[35:55, 85] = False
    inside = np.zeros_like(occupied)
    inside[5:85, 5:165] = True
    return Grid(occupied, inside & ~occupied, ORIGIN, RESOLUTION)


@pytest.fixture
def file(tmp_path: Path) -> Path:
    ros_map.write(tmp_path / "flat.yaml", flat())
    return tmp_path / "flat.yaml"


def test_a_drive_through_the_map_sees_its_walls(file: Path) -> None:
    driven = simulate(MappedBuilding(file), 0)
    found, grid = driven.recording, flat()
    assert found.name == "flat"
    assert driven.ending == "completed"
    assert found.truth is not None
    column = np.floor((found.truth[:, 0] - ORIGIN[0]) / RESOLUTION).astype(int)
    assert np.any(column < 80)
    assert np.any(column > 90)  # both rooms
    level = np.abs(driven.tilt).max(axis=1) < np.deg2rad(0.5)
    beams = np.stack([found.ranges * np.cos(found.angles), found.ranges * np.sin(found.angles)], -1)
    ends = se2.transform(se2.compose(found.truth, found.laser.T_robot_laser), beams)[level].reshape(-1, 2)
    ends = ends[np.isfinite(ends[:, 0])][::50]
    away = np.array([np.hypot(*(grid.occupied_points() - end).T).min() for end in ends])
    assert np.median(away) < RESOLUTION
    assert np.mean(away < 3.0 * RESOLUTION) > 0.95


def test_seeds_vary_the_drive_and_one_seed_does_not(file: Path) -> None:
    one, same, other = (
        MappedBuilding(file).build(np.random.default_rng(seed)).waypoints for seed in (1, 1, 2)
    )
    np.testing.assert_array_equal(one, same)
    assert one.shape != other.shape or not np.allclose(one, other)


def test_a_start_is_where_the_robot_starts_and_looks(file: Path) -> None:
    start = (4.0, 2.5, 1.0)
    source = simulated(str(file), 0, start)
    assert source.recording.truth is not None
    np.testing.assert_allclose(source.recording.truth[0], start, atol=0.05)
    assert source.settings["start"] == start


def unreadable(file: Path) -> None:
    file.with_suffix(".pgm").write_bytes(b"P5\n3 3\n255\n")


def empty(file: Path) -> None:
    file.write_text("")


def unknown(file: Path) -> None:
    nothing = np.zeros((9, 9), dtype=bool)
    ros_map.write(file, Grid(nothing, nothing, ORIGIN, RESOLUTION))


def narrow(file: Path) -> None:
    slit = np.zeros((9, 99), dtype=bool)
    slit[3:6] = True
    ros_map.write(file, Grid(~slit, slit, ORIGIN, RESOLUTION))


def flat_resolution(file: Path) -> None:
    file.write_text(file.read_text().replace("resolution: 0.05", "resolution: 0.0"))


def no_map(file: Path) -> None:
    file.write_text("speed: 3\n")


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (unreadable, "a torn image"),
        (empty, "the file is empty"),
        (unknown, "flat.yaml: no free space"),
        (narrow, "flat.yaml: no place where the robot fits"),
        (flat_resolution, "resolution 0, expected metres per pixel > 0"),
        (no_map, "no resolution, expected image, resolution, origin"),
    ],
)
def test_maps_nobody_can_drive_through(spoil: object, message: str, file: Path) -> None:
    spoil(file)  # type: ignore[operator]
    with pytest.raises(InputError, match=message) as caught:
        simulated(str(file), 0)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("start", "message"),
    [
        ((-2.0, 5.3, 0.0), r"start \(-2, 5.3\) is in unknown space"),
        ((2.27, 2.0, 0.0), r"start \(2.27, 2\) is inside a wall"),
    ],
)
def test_starts_where_no_robot_can_be(start: Pose, message: str, file: Path) -> None:
    with pytest.raises(InputError, match=message):
        simulated(str(file), 0, start)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["nowhere.yaml"], "nowhere.yaml: no such file"),
        (["hospital", "--start", "1", "2", "0"], "--start is for ROS maps"),
        (["flat.yaml", "--laser-mount", "0", "0", "0"], "are for logs"),
    ],
)
def test_options_that_a_map_does_not_have(
    arguments: list[str], message: str, file: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(file.parent)
    monkeypatch.setattr("sys.argv", ["run", *arguments])
    with pytest.raises(InputError, match=message):
        checked(parse(Options, COMMAND))


def test_the_command_runs_a_map_and_refuses_a_start_in_a_wall(
    file: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    line = ["run", str(file), "--methods", "ins", "--out", str(file.parent)]
    monkeypatch.setattr("sys.argv", line)
    assert main(Options, COMMAND, run) == 0
    assert (file.parent / "flat-seed0" / "metrics.json").is_file()
    monkeypatch.setattr("sys.argv", [*line, "--seed", "1", "--start", "2.27", "2.0", "0"])
    assert main(Options, COMMAND, run) == 2
    assert "start (2.27, 2) is inside a wall" in capsys.readouterr().err.splitlines()[-1]
    assert not (file.parent / "flat-seed1").exists()


def on_free_cells(file: Path, seed: int = 0) -> bool:
    """Whether a drive through a map keeps to its free cells."""
    found, drive = ros_map.read_map(file), simulate(MappedBuilding(file), seed).recording
    assert drive.truth is not None
    at = se2.transform(se2.inverse(found.T_map_grid), drive.truth[:, :2]) / found.grid.resolution
    column, row = np.floor(at).astype(int).T
    return bool(np.all(found.grid.free[row, column]))


def test_a_drive_stays_indoors_with_nav2s_free_thresh(file: Path) -> None:
    """The flat has a way out; beyond it nothing is known, which is not free."""
    door = flat()
    door.occupied[20:45, 4], door.free[20:45, 4] = False, True
    ros_map.write(file, door)
    file.write_text(file.read_text().replace("0.196", "0.25"))
    assert on_free_cells(file)


def test_a_yaw_of_the_origin_turns_the_building(file: Path) -> None:
    T_map_grid = np.array([4.0, -3.0, 1.0])
    ros_map.write(file, replace(flat(), origin=T_map_grid[:2]), yaw=T_map_grid[2])
    assert on_free_cells(file)
    inside = se2.transform(T_map_grid, np.array([[6.0, 1.5]]))[0]
    start = (*inside.tolist(), -2.0)
    driven = simulate(MappedBuilding(file, start), 0).recording
    assert driven.truth is not None
    np.testing.assert_allclose(driven.truth[0], start, atol=0.05)
    beams = np.stack([driven.ranges * np.cos(driven.angles), driven.ranges * np.sin(driven.angles)], -1)[::40]
    ends = se2.transform(se2.compose(driven.truth[::40], driven.laser.T_robot_laser), beams).reshape(-1, 2)
    ends = se2.transform(se2.inverse(T_map_grid), ends[np.isfinite(ends[:, 0])])
    walls = replace(flat(), origin=np.zeros(2)).occupied_points()
    away = np.array([np.hypot(*(walls - end).T).min() for end in ends])
    assert np.median(away) < RESOLUTION


def test_a_map_that_states_no_unknown_cell_is_driven_through_indoors(
    file: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    whole = flat()
    wide = np.pad(whole.occupied, 100)  # outdoors there is more room than in the flat
    ros_map.write(file, Grid(wide, ~wide, ORIGIN, RESOLUTION))
    source = simulated(str(file), 0)
    assert "no cell is unknown" in capsys.readouterr().err
    assert source.recording.truth is not None
    column, row = np.floor((source.recording.truth[:, :2] - ORIGIN) / RESOLUTION).astype(int).T
    assert np.all(np.pad(whole.free, 100)[row, column])
