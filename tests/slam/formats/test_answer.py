"""Trajectories that others hand in: every format comes back, covariances in our convention."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from slam import se2
from slam.formats import FormatError, answer, carmen, poses_npz, square, tum
from slam.recording import Laser, Recording
from slam.se2 import Array
from slam.trajectory import Trajectory

TIME = np.array([976052857.25, 976052857.5, 976052857.75])
POSES = np.array([[0.0, 0.0, 0.0], [1.0, -2.0, 3.0], [2.5, 0.5, -1.25]])
TRIANGLE = "0.01 0.002 0.02 0.001 -0.003 0.04"
HEADER = {
    "FORMAT": "SQUARE/0.3",
    "REPRESENTATION": "gaussian_se3",
    "POSE_FRAME": "world",
    "BODY_FRAME": "base_link",
    "GAUGE": "se3",
    "TIMESTAMP_UNIT": "seconds",
    "ALGORITHM": "x",
    "ALGORITHM_VERSION": "1",
    "TANGENT_CONVENTION": "right_perturbation",
    "TANGENT_ORDER": "translation_rotation",
    "ROTATION_PARAM": "axis_angle",
}


def covariances() -> Array:
    spread = np.random.default_rng(0).normal(0.0, 0.1, (3, 3, 3))
    return spread @ np.swapaxes(spread, 1, 2) + 1e-4 * np.eye(3)


def assert_same(found: Trajectory, covariance: Array | None) -> None:
    np.testing.assert_array_equal(found.time, TIME)
    np.testing.assert_allclose(found.poses, POSES, atol=1e-12)
    if covariance is None:
        assert found.covariance is None
    else:
        np.testing.assert_allclose(found.covariance, covariance, atol=1e-15)  # type: ignore[arg-type]


@pytest.mark.parametrize("stated", [False, True])
def test_tum_square_and_npz_come_back(stated: bool, tmp_path: Path) -> None:
    sigma = covariances() if stated else None
    tum.write(tmp_path / "a.tum", TIME, POSES, sigma)
    square.write(tmp_path / "a.square", Trajectory(TIME, POSES, sigma), "x\n#%GAUGE sim3", "1")
    arrays = {"time": TIME, "poses": POSES} | ({} if sigma is None else {"covariance": sigma})
    np.savez_compressed(tmp_path / "a.npz", **arrays)  # type: ignore[arg-type]
    for name in ("a.tum", "a.square", "a.npz"):
        assert_same(answer.read(tmp_path / name), sigma)


def test_a_row_with_its_21_entries_by_hand(tmp_path: Path) -> None:
    """What is in the plane is taken out of the lower triangle, row by row."""
    entries = np.arange(21.0)
    (tmp_path / "a.tum").write_text("1.0 3 4 0 0 0 0 1 " + " ".join(map(str, entries)))
    found = tum.read_trajectory(tmp_path / "a.tum").covariance
    np.testing.assert_array_equal(found, [[[0, 1, 15], [1, 2, 16], [15, 16, 20]]])


def test_a_row_with_6_entries_is_of_the_plane(tmp_path: Path) -> None:
    (tmp_path / "a.tum").write_text(f"1.0 3 4 0 0 0 0 1 {TRIANGLE}\n")
    found = answer.read(tmp_path / "a.tum").covariance
    expected = [[[0.01, 0.002, 0.001], [0.002, 0.02, -0.003], [0.001, -0.003, 0.04]]]
    np.testing.assert_array_equal(found, expected)


def with_header(path: Path, body: str, **changed: str | None) -> Path:
    header = {key: value for key, value in (HEADER | changed).items() if value is not None}
    path.write_text("".join(f"#%{key} {value}\n" for key, value in header.items()) + body)
    return path


def test_square_of_other_conventions_means_the_same(tmp_path: Path) -> None:
    """A left perturbation in the order rotation, translation, of a pose away from the origin."""
    sigma = covariances()
    left = se2.transport(sigma, POSES)
    space = np.zeros((3, 6, 6))
    place = [3, 4, 2]
    space[np.ix_(range(3), place, place)] = left
    rows = [
        tum.lines(TIME[k : k + 1], POSES[k : k + 1]).strip()
        + " "
        + " ".join(repr(float(v)) for v in space[k][np.tril_indices(6)])
        for k in range(3)
    ]
    path = with_header(
        tmp_path / "a.txt",
        "\n".join(rows),
        TANGENT_CONVENTION="left_perturbation",
        TANGENT_ORDER="rotation_translation",
        BODY_FRAME="lidar",
    )
    found = answer.read(path)
    assert_same(found, sigma)
    assert found.body == "laser"


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"FORMAT": "SQUARE/9"}, "FORMAT is 'SQUARE/9', expected SQUARE/0.3"),
        ({"GAUGE": "sim3"}, "GAUGE is 'sim3', expected fixed or se3 or gravity_yaw"),
        ({"REPRESENTATION": "ensemble_se3"}, "is 'ensemble_se3', expected gaussian_se3 or deterministic"),
        ({"TANGENT_ORDER": None}, "TANGENT_ORDER is not stated"),
        ({"TIMESTAMP_UNIT": "nanoseconds"}, "expected seconds"),
        ({"REPRESENTATION": "deterministic"}, "deterministic rows are of 8 values, these"),
    ],
)
def test_a_header_that_leaves_doubt_is_refused(
    changed: dict[str, str | None], message: str, tmp_path: Path
) -> None:
    body = tum.lines(TIME, POSES, covariances())
    with pytest.raises(FormatError, match=message) as caught:
        answer.read(with_header(tmp_path / "a.txt", body, **changed))
    assert "\n" not in str(caught.value)


def test_lines_of_stamp_x_y_theta(tmp_path: Path) -> None:
    (tmp_path / "a.txt").write_text("# stamp x y theta row\n1.0 2 3 7.0 1\n2.0 2 3 0 4\n")
    np.testing.assert_allclose(answer.read(tmp_path / "a.txt").poses[:, 2], [7.0 - 2 * np.pi, 0.0])


BAD: dict[str, tuple[bytes, str]] = {
    "nan": (b"1 nan 0 0 0 0 0 1\n", "value 2 is 'nan', expected a finite number"),
    "widths": (b"1 0 0 0 0 0 0 1\n2 0 0 0 0 0 0 1 1 0 1 0 0 1\n", ":2: pose of 14 values, expected 8 as in"),
    "9 columns": (b"1 0 0 0 0 0 0 1 5\n", "pose of 9 values, expected 8: stamp tx"),
    "empty": (b"", "empty"),
    "binary": (b"\x00\x01\x02", "not text"),
    "zip": (b"PK\x03\x04 and no more", "expected time and poses"),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_files_are_told_in_one_line(name: str, tmp_path: Path) -> None:
    content, message = BAD[name]
    (tmp_path / "a.tum").write_bytes(content)
    with pytest.raises(FormatError, match=message) as caught:
        answer.read(tmp_path / "a.tum")
    assert "\n" not in str(caught.value)


def test_nothing_is_unpickled_and_nothing_huge_is_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    np.savez(tmp_path / "a.npz", time=TIME, poses=np.array([{"a": 1}] * 3, dtype=object))
    with pytest.raises(FormatError, match="torn or foreign npz"):
        answer.read(tmp_path / "a.npz")
    monkeypatch.setattr(poses_npz, "LARGEST_ARRAY", 1000)
    np.savez_compressed(tmp_path / "b.npz", time=np.zeros(1000), poses=POSES)
    with pytest.raises(FormatError, match="an array of 8,128 bytes, expected at most 1,000"):
        answer.read(tmp_path / "b.npz")
    with (tmp_path / "c.tum").open("wb") as file:
        file.truncate(10_000_000_000)  # a hole: takes no room
    with pytest.raises(FormatError, match="10,000,000,000 bytes, expected a trajectory of at most"):
        answer.read(tmp_path / "c.tum")
    np.savez(tmp_path / "d.npz", time=TIME, poses=np.full((3, 3), np.nan))
    with pytest.raises(FormatError, match="poses: expected finite values"):
        answer.read(tmp_path / "d.npz")


# A corrected CARMEN log


def recorded(folder: Path) -> Recording:
    """A log of three scans and two lines of odometry between each, laser 0.3 m ahead."""
    laser = Laser(range_max=20.0, T_robot_laser=np.array([0.3, 0.0, 0.0]))
    reckoned = np.array([[0.0, 0, 0], [1.0, 0, 0], [2.0, 0, 0]])
    ranges = np.ones((3, 5)) + np.arange(3)[:, None]
    recording = Recording("a", TIME, ranges, np.linspace(-1, 1, 5), laser, reckoned, truth=POSES)
    carmen.write(folder / "a.log", recording)
    lines = (folder / "a.log").read_text().splitlines(keepends=True)
    half = "ODOM 0.500000 0.000000 0.000000 0 0 0 976052857.375000 h 976052857.375000\n"
    place = [k for k, line in enumerate(lines) if line.startswith("ROBOTLASER1")][1]
    (folder / "a.log").write_text("".join([*lines[:place], half, *lines[place:], "# the end\n"]))
    return carmen.read(folder / "a.log")


def test_a_corrected_log_is_the_log_line_by_line_with_other_poses(tmp_path: Path) -> None:
    recording = recorded(tmp_path)
    odometry = carmen.odometry_of(tmp_path / "a.log")
    assert len(odometry.time) == 4
    np.testing.assert_array_equal(odometry.scan_row, [0, 2, 3])
    moved = np.array([[5.0, 5, 1.5], [5, 5.5, 1.5], [5, 6, 1.5], [5, 7, 1.5]])
    mount = recording.laser.T_robot_laser
    carmen.write_corrected(tmp_path / "b.log", tmp_path / "a.log", moved, mount)
    before, after = ((tmp_path / name).read_text().splitlines() for name in ("a.log", "b.log"))
    assert len(before) == len(after)
    changed = [new.split()[0] for old, new in zip(before, after, strict=True) if old != new]
    assert changed == ["ROBOTLASER1", "ODOM", "ROBOTLASER1", "ROBOTLASER1"]
    again = carmen.read(tmp_path / "b.log")
    np.testing.assert_allclose(again.dead_reckoning, moved[[0, 2, 3]], atol=1e-6)
    np.testing.assert_array_equal(again.ranges, recording.ranges)
    found = answer.read(tmp_path / "b.log")
    assert found.body == "laser"
    np.testing.assert_allclose(found.poses, se2.compose(moved[[0, 2, 3]], mount), atol=2e-6)
    with pytest.raises(ValueError, match="expected 4 poses, got 3"):
        carmen.write_corrected(tmp_path / "c.log", tmp_path / "a.log", moved[:3], mount)


def test_flaser_lines_are_corrected_where_their_poses_are(tmp_path: Path) -> None:
    line = "FLASER 3 1.0 2.0 3.0 0 0 0 0 0 0 {0} host {0}\n"
    (tmp_path / "a.log").write_text("".join(line.format(k) for k in (1, 2)))
    carmen.write_corrected(tmp_path / "b.log", tmp_path / "a.log", POSES[1:], np.array([0.1, 0, 0]))
    words = (tmp_path / "b.log").read_text().splitlines()[0].split()
    assert words[:5] == ["FLASER", "3", "1.0", "2.0", "3.0"]
    laser = se2.compose(POSES[1], [0.1, 0, 0])
    np.testing.assert_allclose(list(map(float, words[5:11])), [*laser, *POSES[1]], atol=1e-6)
    assert words[11:] == ["1", "host", "1"]


def test_another_laser_s_lines_keep_their_own_mount(tmp_path: Path) -> None:
    front = "FLASER 2 1.0 2.0 0 0 0 0 0 0 {0} host {0}\n"
    rear = "RLASER 2 1.0 2.0 -0.2 0 3.0 0 0 0 {0} host {0}\n"
    (tmp_path / "a.log").write_text(rear.format(0) + "".join((front + rear).format(k) for k in (1, 2)))
    carmen.write_corrected(tmp_path / "b.log", tmp_path / "a.log", POSES[1:], np.zeros(3))
    lines = [line.split() for line in (tmp_path / "b.log").read_text().splitlines()]
    assert [line[0] for line in lines] == ["RLASER", "FLASER", "RLASER", "FLASER", "RLASER"]
    assert lines[0][4:7] == ["-0.2", "0", "3.0"]  # nothing is known before the first scan
    expected = [*se2.compose(POSES[2], [-0.2, 0.0, 3.0]), *POSES[2]]
    np.testing.assert_allclose(list(map(float, lines[4][4:10])), expected, atol=1e-6)


def test_a_log_without_poses_cannot_be_corrected(tmp_path: Path) -> None:
    line = "RAWLASER1 0 -1.0 2.0 1.0 20.0 0.01 0 3 1.0 2.0 3.0 0 {0} host {0}\n"
    (tmp_path / "a.log").write_text("".join(line.format(k) for k in (1, 2)))
    with pytest.raises(FormatError, match="RAWLASER1 states no pose"):
        carmen.odometry_of(tmp_path / "a.log")
    with pytest.raises(FormatError, match="RAWLASER1 states no pose"):
        answer.read(tmp_path / "a.log")
