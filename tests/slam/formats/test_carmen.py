"""CARMEN logs: small ones made here, and the real ones."""

from __future__ import annotations

import gzip
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from slam import se2
from slam.formats import FormatError, carmen, field_of_view, load
from slam.formats.text import File
from slam.recording import Recording
from slam.se2 import Array


def odom(time: float, x: float, y: float = 0.0, theta: float = 0.0) -> str:
    return f"ODOM {x} {y} {theta} 0 0 0 {time} host {time}\n"


def flaser(time: float, ranges: list[float], laser: str = "0 0 0", robot: str = "0 0 0") -> str:
    return f"FLASER {len(ranges)} {' '.join(map(str, ranges))} {laser} {robot} {time} host {time}\n"


def robotlaser(time: float, ranges: list[float], laser: str = "0 0 0", robot: str = "0 0 0") -> str:
    """Four metres at most, from -90° in steps of 45°, with one remission value."""
    head = f"ROBOTLASER1 0 {-np.pi / 2} {np.pi} {np.pi / 4} 4.0 0.01 0 {len(ranges)}"
    return f"{head} {' '.join(map(str, ranges))} 1 77 {laser} {robot} 0 0 0 0 0 {time} host {time}\n"


def parse(text: str) -> Recording:
    return carmen.read(File("a.log", text.encode()))


RIGHT_TO_LEFT = [1.0] + [2.0] * 89 + [3.0] + [2.0] * 89 + [4.0]


@pytest.mark.parametrize(
    ("beams", "first", "last"), [(180, -90, 89), (181, -90, 90), (360, -90, 89.5), (361, -90, 90)]
)
def test_field_of_view_follows_from_the_number_of_beams(beams: int, first: float, last: float) -> None:
    angles = np.degrees(parse(flaser(1.0, [1.0] * beams)).angles)
    assert len(angles) == beams
    np.testing.assert_allclose(angles[[0, -1]], [first, last])


def test_first_beam_is_the_rightmost() -> None:
    recording = parse(flaser(1.0, RIGHT_TO_LEFT))
    points = recording.ranges[0, :, None] * np.stack([np.cos(recording.angles), np.sin(recording.angles)], -1)
    np.testing.assert_allclose(points[[0, 90, 180]], [[0, -1], [3, 0], [0, 4]], atol=1e-12)


def test_error_codes_of_the_laser_are_no_return() -> None:
    ranges = [81.83, 81.91, 80.0, 79.99, 0.0] + [1.0] * 176
    np.testing.assert_array_equal(
        parse(flaser(1.0, ranges)).ranges[0, :6], [np.nan, np.nan, np.nan, 79.99, np.nan, 1.0]
    )


def test_odometry_is_kept_at_its_full_rate() -> None:
    ranges = [1.0] * 181
    text = odom(1.0, 0.0) + odom(2.0, 0.1) + flaser(2.0, ranges, robot="0.1 0 0") + odom(3.0, 0.2)
    text += "PARAM robot_length 0.5\n" + flaser(3.5, ranges, robot="0.3 0 0.1") + odom(4.0, 0.4)
    recording = parse(text)
    np.testing.assert_allclose(recording.dead_reckoning, [[0.1, 0, 0], [0.3, 0, 0.1]])
    assert recording.odometry is not None
    # The first scan's pose was logged just before it; the second's is a record of its own.
    assert recording.odometry.time.tolist() == [1.0, 2.0, 3.0, 3.5, 4.0]
    assert recording.odometry.scan_row.tolist() == [1, 3]
    np.testing.assert_allclose(
        recording.odometry.poses[recording.odometry.scan_row], recording.dead_reckoning
    )


def test_without_odometry_lines_there_is_no_full_rate() -> None:
    assert parse(flaser(1.0, [1.0] * 181) + flaser(2.0, [1.0] * 181)).odometry is None


def test_stamps_going_backwards_keep_file_order() -> None:
    recording = parse(flaser(2.0, [1.0] * 181) + odom(1.9, 0) + odom(1.8, 0) + flaser(1.0, [2.0] * 181))
    assert recording.time.tolist() == [2.0, 1.0]
    assert recording.odometry is not None
    assert recording.odometry.time.tolist() == [2.0, 1.9, 1.8, 1.0]


def test_a_constant_offset_of_the_laser_is_its_mount() -> None:
    ranges = [1.0] * 181
    text = flaser(1.0, ranges, laser="1.04 2 0", robot="1 2 0")
    turned = flaser(2.0, ranges, laser="1 2.04 1.570796", robot="1 2 1.570796")
    np.testing.assert_allclose(parse(text + turned).laser.T_robot_laser, [0.04, 0, 0], atol=1e-9)


def test_a_changing_offset_is_a_corrected_pose_not_a_mount() -> None:
    ranges = [1.0] * 181
    text = flaser(1.0, ranges, laser="1.04 2 0", robot="1 2 0")
    recording = parse(text + flaser(2.0, ranges, laser="1.5 2.2 0.1", robot="1.3 2 0"))
    assert recording.laser.T_robot_laser.tolist() == [0, 0, 0]
    np.testing.assert_allclose(recording.dead_reckoning, [[1, 2, 0], [1.3, 2, 0]])


def test_robotlaser_states_its_own_geometry() -> None:
    recording = parse(robotlaser(5.0, [1.0, 2.0, 3.0, 3.9, 4.0], laser="1.1 0 0", robot="1 0 0"))
    np.testing.assert_allclose(np.degrees(recording.angles), [-90, -45, 0, 45, 90])
    np.testing.assert_array_equal(recording.ranges, [[1.0, 2.0, 3.0, 3.9, np.nan]])
    assert recording.laser.range_max == 4.0
    np.testing.assert_allclose(recording.laser.T_robot_laser, [0.1, 0, 0])
    np.testing.assert_allclose(recording.dead_reckoning, [[1, 0, 0]])
    assert recording.time.tolist() == [5.0]


def test_the_older_message_is_read_where_a_log_has_both() -> None:
    recording = parse(robotlaser(1.0, [1.0] * 5) + flaser(1.0, [1.0] * 181) + robotlaser(2.0, [1.0] * 5))
    assert recording.ranges.shape == (1, 181)


GOOD = odom(1.0, 0.0) + flaser(1.0, RIGHT_TO_LEFT)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (odom(1.0, 0.0), "a.log: no range scans"),
        (GOOD[:300], "a.log:2: FLASER of .* values, expected 181 ranges and 9 more: cut in the middle"),
        (GOOD + "ODOM 1 2 3 0 0", "a.log:3: ODOM of 5 values, expected 9: cut in the middle"),
        (GOOD + "FLAS", "a.log:3: line ends in 'FLAS', .* cut in the middle"),
        (GOOD + "ODOM", "a.log:3: line ends in 'ODOM', .* cut in the middle"),
        (GOOD + "FLASER \n", "a.log:3: FLASER count is 'nothing'"),
        (GOOD.replace(" 3.0 ", " three "), "a.log:2: FLASER range: value 91 is 'three'"),
        (GOOD + flaser(2.0, [1.0] * 180), "a.log:3: scan of 180 ranges, expected 181 as most scans have"),
        (flaser(1.0, []), "a.log:1: scan of 0 ranges, expected at least one"),
        (GOOD.replace("FLASER 181", "FLASER 1²1"), "a.log:2: FLASER count is '1²1', expected a whole number"),
        (GOOD.replace("FLASER 181", f"FLASER {'9' * 5000}"), "a.log:2: FLASER count is '999"),
        (
            GOOD.replace("ODOM 0.0", "ODOM 1e300"),
            "a.log:1: ODOM: value 1 is '1e300', expected a finite number",
        ),
        (odom(1.0, float("inf")) + GOOD, "a.log:1: ODOM: value 1 is 'inf'"),
        (flaser(1.0, [1.0] * 7), "a.log:1: FLASER of 7 beams .* --field-of-view DEG"),
        (
            robotlaser(1.0, [1.0] * 5)[:-9],
            "a.log:1: ROBOTLASER1 of 27 values, expected 29: cut in the middle",
        ),
        (robotlaser(1.0, [1.0] * 5)[:-40], "a.log:1: ROBOTLASER1 remission count is 'nothing'"),
    ],
)
def test_bad_input_is_named_in_one_line(text: str, message: str) -> None:
    with pytest.raises(FormatError, match=message) as caught:
        parse(text)
    assert "\n" not in str(caught.value)


NO_RETURN = ("nan", "-nan", "inf", "-inf", "NaN", "1.#INF", "-1.#IND", "-nan(ind)", "-3.0", "0.02", "1e300")


@pytest.mark.parametrize("word", NO_RETURN)
def test_what_is_no_distance_is_no_return(word: str) -> None:
    ranges = parse(GOOD.replace(" 3.0 ", f" {word} ")).ranges[0]
    assert np.isnan(ranges[90])
    assert np.isfinite(np.delete(ranges, 90)).all()


def rawlaser(time: float, ranges: list[float], number: int = 1) -> str:
    head = f"RAWLASER{number} 0 {-np.pi / 2} {np.pi} {np.pi / 4} 4.0 0.01 0 {len(ranges)}"
    return f"{head} {' '.join(map(str, ranges))} 0 {time} host {time}\n"


@pytest.mark.parametrize("number", [1, 2])
def test_a_raw_laser_has_its_poses_from_the_odometry_around_it(number: int) -> None:
    mount = "PARAM robot_frontlaser_offset 0.26 0 host 0\n"
    scans = rawlaser(1.5, [1.0] * 5, number) + odom(2.0, 0.2) + rawlaser(2.0, [1.5] * 5, number)
    recording = parse(mount + odom(1.0, 0.0) + scans + odom(3.0, 0.5, theta=0.1))
    np.testing.assert_allclose(recording.dead_reckoning, [[0.1, 0, 0], [0.2, 0, 0]])
    np.testing.assert_allclose(np.degrees(recording.angles), [-90, -45, 0, 45, 90])
    assert recording.laser.T_robot_laser.tolist() == [0.26, 0, 0]
    assert recording.source == "odometry"
    assert recording.odometry is not None
    assert recording.odometry.scan_row.tolist() == [0, 1]


def test_a_raw_laser_without_odometry_has_no_dead_reckoning() -> None:
    assert parse(rawlaser(1.0, [1.0] * 5) + rawlaser(2.0, [1.0] * 5)).source == "none"


@pytest.mark.parametrize("name", ["RLASER", "ROBOTLASER2"])
def test_another_laser_alone_is_read(name: str) -> None:
    line = flaser(1.0, RIGHT_TO_LEFT) if name == "RLASER" else robotlaser(1.0, RIGHT_TO_LEFT[:5])
    recording = parse(line.replace("FLASER", name).replace("ROBOTLASER1", name))
    assert recording.ranges[0, 1] == 2.0
    both = parse(flaser(1.0, RIGHT_TO_LEFT) + flaser(1.0, [5.0] * 181).replace("FLASER", "RLASER"))
    assert np.nanmax(both.ranges) == 4.0
    assert both.notes[1:] == ("left out RLASER",)


def test_a_logger_may_leave_out_host_and_stamp() -> None:
    short = flaser(1.0, RIGHT_TO_LEFT).replace(" host 1.0", "")
    assert parse(short * 2).ranges.shape == (2, 181)
    with pytest.raises(FormatError, match=r"a.log:2: FLASER of 188 values, .* cut in the middle"):
        parse(GOOD.removeprefix(odom(1.0, 0.0)) + short)


def test_a_single_scan_of_other_beams_is_left_out() -> None:
    scans = [flaser(float(k), [1.0 + k] * (180 if k == 3 else 181), robot=f"{k} 0 0") for k in range(12)]
    recording = parse("".join(scans))
    assert recording.time.tolist() == [0, 1, 2, *range(4, 12)]
    assert recording.dead_reckoning[3].tolist() == [4, 0, 0]
    assert recording.notes[-1] == "1 of 12 scans left out: another number of beams"


@pytest.mark.parametrize(
    ("beams", "degrees"), [(181, 180), (360, 180), (360, 360), (180, 360), (541, 270), (301, 240)]
)
def test_the_field_of_view_is_the_one_with_which_scans_fit(
    room: Array, record: Callable[..., Recording], curve: Callable[..., Array], beams: int, degrees: int
) -> None:
    """A number of beams, whatever is usual for it, over the angles at which they were really taken."""
    angles = field_of_view.angles(beams, degrees)
    drive = record(room, curve(), angles=angles)
    lines = [
        flaser(k, np.round(ranges, 3).tolist(), "0 0 0", " ".join(map(str, pose)))
        for k, (ranges, pose) in enumerate(zip(drive.ranges, drive.dead_reckoning, strict=True))
    ]
    recording = parse("".join(lines))
    np.testing.assert_allclose(recording.angles, angles)
    assert "as one scan fits the next" in recording.notes[0]


def test_no_field_of_view_is_made_up_for_an_unusual_laser(
    room: Array, record: Callable[..., Recording], curve: Callable[..., Array]
) -> None:
    drive = record(room, curve(), angles=field_of_view.angles(301, 210))
    assert field_of_view.field_of_view(drive.ranges, drive.dead_reckoning) is None


def test_a_stated_field_of_view_comes_first(tmp_path: Path) -> None:
    (tmp_path / "a.log").write_text(flaser(1.0, [1.0] * 360) + robotlaser(1.0, [1.0] * 5))
    assert (
        "FLASER, 360 beams over 179.5° (not stated, taken as usual: --field-of-view"
        in load(tmp_path / "a.log").notes[0]
    )
    stated = load(tmp_path / "a.log", field_of_view=360.0)
    np.testing.assert_allclose(np.degrees(stated.angles[[0, 180, -1]]), [-180, 0, 179], atol=1e-9)
    (tmp_path / "b.log").write_text(robotlaser(1.0, [1.0] * 5))
    assert np.degrees(load(tmp_path / "b.log", field_of_view=120.0).angles).tolist() == pytest.approx(
        [-60, -30, 0, 30, 60]
    )


def test_plain_and_gzipped_are_the_same(tmp_path: Path) -> None:
    (tmp_path / "a.log").write_text(GOOD)
    (tmp_path / "a.log.gz").write_bytes(gzip.compress(GOOD.encode()))
    plain, packed = carmen.read(tmp_path / "a.log"), carmen.read(tmp_path / "a.log.gz")
    np.testing.assert_array_equal(plain.ranges, packed.ranges)
    assert plain.name == packed.name == "a"


@pytest.fixture(scope="module")
def intel(shared_data: Path) -> Recording:
    return carmen.read(shared_data / "carmen/intel.raw.log.gz")


def test_intel(intel: Recording) -> None:
    assert intel.ranges.shape == (910, 180)
    assert intel.odometry is not None
    assert len(intel.odometry.time) == 13631  # its scans' poses are among its ODOM lines
    np.testing.assert_array_equal(intel.odometry.poses[intel.odometry.scan_row], intel.dead_reckoning)
    np.testing.assert_array_equal(intel.odometry.time[intel.odometry.scan_row], intel.time)
    assert np.nanmax(intel.ranges) < 30.0
    assert np.sum(np.diff(intel.odometry.time) < 0) == 629  # file order kept
    assert float(se2.path_length(intel.odometry.poses)[-1]) == pytest.approx(508, abs=1)


def test_intel_is_sharpest_as_read(intel: Recording, shared_data: Path) -> None:
    """With GMapping's published poses, not truth but a peer's good map."""
    poses = np.loadtxt(shared_data / "carmen/intel.gmapping_ref.txt")[:, 1:4]

    def occupied_cells(angles: np.ndarray) -> int:
        ends = intel.ranges[..., None] * np.stack([np.cos(angles), np.sin(angles)], -1)
        points = se2.transform(poses, ends).reshape(-1, 2)
        return len(np.unique(np.floor(points[np.isfinite(points[:, 0])] / 0.05).astype(int), axis=0))

    as_read = occupied_cells(intel.angles)
    assert as_read < occupied_cells(intel.angles + np.deg2rad(0.5))  # -89.5° to 89.5°
    assert as_read < occupied_cells(np.linspace(-np.pi / 2, np.pi / 2, 180))
    assert 2 * as_read < occupied_cells(-intel.angles)


def test_csail(shared_data: Path) -> None:
    recording = carmen.read(shared_data / "carmen/csail.raw.log.gz")
    assert recording.ranges.shape == (406, 361)
    assert recording.laser.T_robot_laser.tolist() == [0, 0, 0]
    assert recording.odometry is not None
    assert len(recording.odometry.time) == 1987


def test_none_is_said_of_one_pose_only() -> None:
    said = "PARAM slamstitch_dead_reckoning none 0 slamstitch 0\n"
    scans = [flaser(float(k), [1.0] * 181, f"{x} 0 0", f"{x} 0 0") for k, x in enumerate((2.0, 2.0, 2.5))]
    assert parse(said + scans[0] + scans[1]).source == "none"
    with pytest.raises(FormatError, match="slamstitch_dead_reckoning is 'none', expected one robot pose"):
        parse(said + "".join(scans))
