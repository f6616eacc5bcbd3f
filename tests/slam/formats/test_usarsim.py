"""USARSim logs: a room of known shape in both dialects, and the real logs."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from slam import se2
from slam.formats import FormatError, usarsim
from slam.formats.text import File
from slam.recording import Recording

HEADER = "# UvA Rescue Team Logfile\n#\n\n"
INIT = "INIT {ClassName USARBot.kenaf} {Name R} {Location 1.0,2.0,0.0} {Rotation 0.0000,0.0000,1.5708} \n"
GEO = "GEO {Type RangeScanner} {Name H} {Location -0.00,-0.08,-0.14} {Orientation -0.00,-0.00,-0.00}\n"
CONF = (
    "CONF {Type RangeScanner} {Name H} {MaxRange 4.0000} {MinRange 0.1000} {Resolution 0.7854} {Fov 3.1416}\n"
)
OLD_GEO = (
    "GEO {Type RangeScanner} {Name S1 Location 0.1440,0.0200,-0.0919 Orientation 0.0,0.0,0.5 Mount HARD}\n"
)


def truth(time: float, x: float, y: float, yaw: float, z: float = 1.5) -> str:
    stamp = f"SEN {{Time {time:.4f}}} {{Type GroundTruth}} {{Name GndTruth}}"
    return f"{stamp} {{Location {x:.2f},{y:.2f},{z:.2f}}} {{Orientation 0.00,-0.00,{yaw:.2f}}}\n"


def ins(x: float, y: float, roll: float, pitch: float, yaw: float) -> str:
    return f"SEN {{Type INS}} {{Name I}} {{Location {x},{y},1.27}} {{Orientation {roll},{pitch},{yaw}}}\n"


def scan(time: float, ranges: str, name: str = "H", shape: str = "{Resolution 0.7854} {FOV 3.1416}") -> str:
    return f"SEN {{Time {time:.4f}}} {{Type RangeScanner}} {{Name {name}}} {shape} {{Range {ranges}}}\n"


def parse(text: str) -> Recording:
    return usarsim.read(File("Robot1.log", text.encode()))


FIVE = "1.00,2.00,3.00,0.00,30.32"
ROOM = (
    HEADER
    + INIT
    + GEO
    + CONF
    + truth(10.0, 1.0, 2.0, 1.57)
    + ins(1.1, 2.1, 6.28, 0.1, 6.18)
    + scan(10.0, FIVE)
)


def test_first_beam_is_the_rightmost() -> None:
    # A wall 1 m to the robot's right, 2 m to the front right, 3 m ahead: printed from right to left.
    recording = parse(ROOM)
    np.testing.assert_allclose(np.degrees(recording.angles), [-90, -45, 0, 45, 90], atol=0.01)
    x, y = recording.ranges[0] * np.cos(recording.angles), recording.ranges[0] * np.sin(recording.angles)
    np.testing.assert_allclose(np.stack([x, y], -1)[:3], [[0, -1], [2**0.5, -(2**0.5)], [3, 0]], atol=6e-3)


def test_zero_and_everything_from_the_maximum_on_is_no_return() -> None:
    recording = parse(ROOM.replace(FIVE, "4.00,3.99,0.09,0.00,30.32"))
    np.testing.assert_array_equal(recording.ranges[0], [np.nan, 3.995, np.nan, np.nan, np.nan])
    assert (recording.laser.range_min, recording.laser.range_max) == (0.1, 4.0)


@pytest.mark.parametrize("word", ["nan", "inf", "-1.#IND", "1.#QNAN", "-3.00"])
def test_what_is_no_distance_is_no_return(word: str) -> None:
    ranges = parse(ROOM.replace("3.00,", f"{word},")).ranges[0]
    np.testing.assert_array_equal(ranges, [1.005, 2.005, np.nan, np.nan, np.nan])


def test_a_field_of_view_in_degrees() -> None:
    degrees = parse(ROOM.replace("{Resolution 0.7854} {FOV 3.1416}", "{Resolution 45} {FOV 180}"))
    np.testing.assert_allclose(np.degrees(degrees.angles), [-90, -45, 0, 45, 90])


def test_a_field_of_view_that_the_user_states() -> None:
    text = ROOM.replace("{FOV 3.1416}", "").encode()
    recording = usarsim.read(File("a.log", text, field_of_view=120.0))
    np.testing.assert_allclose(np.degrees(recording.angles), [-60, -30, 0, 30, 60])


def test_the_scanner_that_is_read_is_named_and_the_others_are() -> None:
    recording = parse(ROOM + scan(10.0, FIVE, name="Rear"))
    assert recording.notes == ("range scanner H, 5 beams over 180° (stated)", "left out Rear")


@pytest.mark.parametrize("clock", ["12:00:01.003 ", "[2012-04-05 12:00:01] ", "1333622401.25 "])
def test_lines_may_begin_with_the_clock_of_who_wrote_them(clock: str) -> None:
    text = "".join(clock + line for line in ROOM.removeprefix(HEADER).splitlines(keepends=True))
    assert usarsim.recognise(File("a.log", text.encode()))
    np.testing.assert_array_equal(parse(text).ranges, parse(ROOM).ranges)
    np.testing.assert_array_equal(parse(text).laser.T_robot_laser, parse(ROOM).laser.T_robot_laser)


@pytest.mark.parametrize(("printed", "meant"), [("2.71", 2.715), ("2.7182", 2.71825), ("2", 2.0)])
def test_ranges_are_the_middle_of_what_prints_so(printed: str, meant: float) -> None:
    """USARSim cuts the digits off after the last one printed; a whole number tells of no such thing."""
    ranges = parse(ROOM.replace(FIVE, ",".join([printed] * 5))).ranges
    np.testing.assert_allclose(ranges, meant, rtol=1e-12)


def test_axes_become_y_left_and_yaw_counter_clockwise() -> None:
    recording = parse(ROOM)
    assert recording.truth is not None
    np.testing.assert_allclose(recording.truth, [[1.0, -2.0, -1.57]])
    np.testing.assert_allclose(recording.dead_reckoning, [[1.1, -2.1, 2 * np.pi - 6.18]])
    assert recording.source == "ins"


def test_attitude_is_wrapped_with_nose_down_positive() -> None:
    # Printed 6.28 is a hair below zero; x forward, y right, z down has its nose up at a positive pitch.
    attitude = parse(ROOM).attitude
    np.testing.assert_allclose(attitude, [[6.28 - 2 * np.pi, -0.1]])


def test_mount_is_printed_in_the_axes_of_the_world_at_the_spawn_pose() -> None:
    np.testing.assert_allclose(parse(ROOM).laser.T_robot_laser, [-0.08, 0.0, 0.0])
    assert parse(ROOM.replace(INIT, "")).laser.T_robot_laser == pytest.approx([0.0, 0.08, 0.0])


def test_mount_of_the_older_dialect() -> None:
    text = HEADER + OLD_GEO + truth(1.0, 0, 0, 0) + ins(0, 0, 0, 0, 0) + scan(1.0, FIVE, name="S1")
    laser = parse(text).laser
    np.testing.assert_allclose(laser.T_robot_laser, [0.144, -0.02, -0.5])
    assert laser.range_max == 20.0


def test_ins_between_its_records_is_interpolated_the_short_way_round() -> None:
    # The scan at 10.1 s lies half way between records at 10.0 and 10.2 s, whose yaw passes 2 pi.
    text = HEADER + CONF + truth(10.0, 0, 0, 0) + ins(1.0, 0.0, 0, 0, 0.1) + truth(10.1, 0, 0, 0)
    text += scan(10.1, FIVE) + truth(10.2, 0, 0, 0) + ins(2.0, 1.0, 0, 0, 6.18)
    expected = [1.5, -0.5, -(0.1 + 6.18 - 2 * np.pi) / 2]
    np.testing.assert_allclose(parse(text).dead_reckoning, [expected], atol=1e-9)


def test_a_scan_stamped_one_tick_late_does_not_turn_back_the_clock() -> None:
    # As older simulators log: a sonar opens the tick at 11 s, the scan still says 10 s, the INS says nothing.
    sonar = "SEN {Time 11.0} {Type Sonar} {Name F1 Range 1.0}\n"
    text = HEADER + truth(10.0, 0, 0, 0) + ins(5, 0, 0, 0, 0) + sonar + scan(10.0, FIVE) + ins(6, 0, 0, 0, 0)
    recording = parse(text)
    assert recording.time.tolist() == [10.0]
    np.testing.assert_allclose(recording.dead_reckoning[:, 0], [5.0])


def test_stamps_going_backwards_keep_file_order() -> None:
    text = ROOM + truth(3.0, 7.0, 0, 0) + ins(7.0, 0, 0, 0, 0) + scan(3.0, FIVE)
    recording = parse(text)
    assert recording.time.tolist() == [10.0, 3.0]
    np.testing.assert_allclose(recording.dead_reckoning[:, 0], [1.1, 7.0])


def test_a_scan_without_stamp_has_the_last_one_seen() -> None:
    text = ROOM.replace("SEN {Time 10.0000} {Type RangeScanner}", "SEN {Type RangeScanner}")
    assert parse(text).time.tolist() == [10.0]


def test_odometry_serves_where_there_is_no_ins() -> None:
    odometry = "SEN {Time 1.0} {Type Odometry} {Name Odometry} {Pose 1.0,2.0,0.5}\n"
    recording = parse(HEADER + odometry + scan(1.0, FIVE))
    assert recording.source == "odometry"
    np.testing.assert_allclose(recording.dead_reckoning, [[1.0, -2.0, -0.5]])
    assert recording.attitude is None
    assert recording.truth is None


def test_a_second_scanner_is_left_out() -> None:
    assert len(parse(ROOM + scan(10.1, "1,2,3", name="Tilted"))) == 1


def test_last_beam_may_fall_short_of_the_field_of_view() -> None:
    # The Kenaf's 228 beams are 192 rotator units apart; 0.0184 is that, rounded.
    shape = "{Resolution 0.0184} {FOV 4.1889}"
    angles = parse(ROOM.replace(scan(10.0, FIVE), scan(10.0, ",".join(["1.0"] * 228), shape=shape))).angles
    np.testing.assert_allclose(np.diff(angles), 192 * np.pi / 32768)
    assert angles[0] == pytest.approx(-4.1889 / 2)
    assert angles[-1] < 4.1889 / 2 - 0.005


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (ROOM.replace(scan(10.0, FIVE), ""), "Robot1.log: no range scans"),
        (ROOM.replace("3.00,", "3.0x,"), "Robot1.log:9: Range: value 3 is '3.0x'"),
        (ROOM + scan(10.1, "1.0,2.0"), "Robot1.log:10: scan of 2 ranges, expected 5"),
        (ROOM[: ROOM.index("3.00,")], "Robot1.log:9: line ends in .* cut in the middle"),
        (ROOM + "STA {Time 1", "Robot1.log:10: line ends in .* cut in the middle"),
        (ROOM + "SE", "Robot1.log:10: line ends in 'SE'.* cut in the middle"),
        (ROOM + "SEN {Time 10.0}", "Robot1.log:10: SEN without {Type"),
        (ROOM + "SEN {Type RangeScanner} {Name H}\n", "Robot1.log:10: RangeScanner without {Range"),
        (
            ROOM + "SEN {Type GroundTruth} {Location 1,2,3}",
            "Robot1.log:10: GroundTruth Orientation: 0 values",
        ),
        (ROOM + "SEN {Type INS} {Location 1,2} {Orientation 1,2,3}", "Robot1.log:10: INS Location: 2 values"),
        (ROOM.replace("{FOV 3.1416}", ""), "Robot1.log:9: RangeScanner without {FOV"),
        (ROOM.replace("{MaxRange 4.0000}", "{MaxRange 0.05}"), "MinRange 0.1, MaxRange 0.05, expected"),
        (re.sub(r"\{Time [0-9.]+\} ", "", ROOM), "Robot1.log: no time stamps"),
    ],
)
def test_bad_input_is_named_in_one_line(text: str, message: str) -> None:
    with pytest.raises(FormatError, match=message) as caught:
        parse(text)
    assert "\n" not in str(caught.value)


def test_a_log_without_ins_and_odometry_has_no_dead_reckoning() -> None:
    recording = parse(re.sub(r"SEN \{Type INS.*\n", "", ROOM))
    assert recording.source == "none"
    np.testing.assert_array_equal(recording.dead_reckoning, np.zeros((len(recording), 3)))
    assert recording.attitude is None


def occupied_cells(recording: Recording, angles: np.ndarray, mount: np.ndarray) -> int:
    """How many 3 cm cells the map drawn with true poses fills: the sharper, the fewer."""
    ends = np.stack([recording.ranges * np.cos(angles), recording.ranges * np.sin(angles)], -1)
    points = se2.transform(se2.compose(recording.truth, mount), ends).reshape(-1, 2)
    points = points[np.isfinite(points[:, 0])]
    return len(np.unique(np.floor(points / 0.03).astype(int), axis=0))


@pytest.fixture(scope="module")
def experiment_1(shared_data: Path) -> Recording:
    return usarsim.read(shared_data / "usarsim/iro2012-pre2/Robot1.log")


def test_experiment_1_as_its_log_states_it(experiment_1: Recording) -> None:
    assert experiment_1.ranges.shape == (1231, 228)
    assert experiment_1.source == "ins"
    assert (experiment_1.laser.range_min, experiment_1.laser.range_max) == (0.1, 4.0)
    np.testing.assert_allclose(experiment_1.laser.T_robot_laser, [-0.08, 0.0, 0.0])
    assert experiment_1.time[-1] - experiment_1.time[0] == pytest.approx(369.08, abs=0.01)
    assert np.nanmax(experiment_1.ranges) < 4.0
    assert experiment_1.distance == pytest.approx(108.0, abs=1.5)


def test_experiment_1_is_sharpest_as_read(experiment_1: Recording) -> None:
    angles, mount = experiment_1.angles, experiment_1.laser.T_robot_laser
    as_read = occupied_cells(experiment_1, angles, mount)
    assert as_read < 9500
    assert occupied_cells(experiment_1, angles, np.zeros(3)) > 1.5 * as_read
    assert occupied_cells(experiment_1, -angles[::-1], -mount) > 1.5 * as_read
    assert occupied_cells(experiment_1, -angles, mount) > 6 * as_read
    evenly_spread = np.linspace(angles[0], -angles[0], len(angles))
    assert occupied_cells(experiment_1, evenly_spread, mount) > 1.05 * as_read


def aligned_error(recording: Recording) -> float:
    """Position rms [m] of the dead reckoning after the best rotation and translation (no scale)."""
    assert recording.truth is not None
    a = recording.dead_reckoning[:, :2] - recording.dead_reckoning[:, :2].mean(axis=0)
    b = recording.truth[:, :2] - recording.truth[:, :2].mean(axis=0)
    yaw = np.arctan2(np.sum(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]), np.sum(a * b))
    return float(np.sqrt(np.mean(np.sum((b - a @ se2.rotation(yaw).T) ** 2, axis=1))))


def test_ins_of_experiment_1_is_as_good_as_known(experiment_1: Recording) -> None:
    assert aligned_error(experiment_1) == pytest.approx(0.051, abs=0.0005)


def test_the_older_robot(shared_data: Path) -> None:
    recording = usarsim.read(shared_data / "usarsim/circle/circle.log")
    assert recording.ranges.shape == (1274, 181)
    assert recording.source == "ins"
    np.testing.assert_allclose(recording.laser.T_robot_laser, [0.144, 0.0, 0.0])
    assert aligned_error(recording) == pytest.approx(0.067, abs=0.002)
    assert np.nanmax(recording.ranges) < 19.98
    as_read = occupied_cells(recording, recording.angles, recording.laser.T_robot_laser)
    assert occupied_cells(recording, recording.angles, np.zeros(3)) > 1.2 * as_read
    assert occupied_cells(recording, -recording.angles, recording.laser.T_robot_laser) > 2 * as_read


def test_climbing_is_nose_up(shared_data: Path) -> None:
    """Where the older robot drives up, pitch is negative: our sign, from truth height and INS pitch."""
    path = shared_data / "usarsim/circle/circle.log"
    recording = usarsim.read(path)
    text = path.read_text()
    height = -np.array(
        [float(m) for m in re.findall(r"GroundTruth\} \{Location [^,]+,[^,]+,([^}]+)\}", text)]
    )
    assert recording.truth is not None
    assert recording.attitude is not None
    step = se2.between(recording.truth[:-1], recording.truth[1:])[:, 0]
    moving = np.abs(step) > 0.05
    height = np.concatenate([height[:1], height[: len(recording) - 1]])  # the record before each scan
    slope = np.diff(height)[moving] / step[moving]
    assert np.corrcoef(slope, recording.attitude[:-1, 1][moving])[0, 1] < -0.4
