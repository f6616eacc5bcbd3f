"""CARMEN logs: one message per line, stamped by the sender.

``FLASER n r1..rn x y theta odom_x odom_y odom_theta ipc_timestamp host logger_timestamp`` and
``ODOM x y theta tv rv accel ipc_timestamp host logger_timestamp``; the newer ``ROBOTLASER1`` and
``RAWLASER1`` also state their field of view, ``RAWLASER1`` no pose. Lines keep their order: stamps of
different senders may go backwards.

Our own logs keep more of a recording: truth in ``TRUEPOS``, an INS's attitude in ``IMU``, and what CARMEN has
no word for in ``PARAM``.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from os import PathLike
from pathlib import Path
from typing import get_args

import numpy as np

from slam import se2
from slam.formats import field_of_view as fov
from slam.formats import quaternion
from slam.formats.pose_records import PoseRecords
from slam.formats.text import (
    File,
    FormatError,
    numbers,
    printable_ranges,
    range_matrix,
    ranges_of,
    recording_name,
    whole,
)
from slam.recording import Laser, Odometry, Recording, Source
from slam.se2 import Array
from slam.trajectory import Trajectory

SICK_RANGE_MAX = 80.0
"""Reach of a SICK LMS 2xx [m]; it reports 81.83 .. 81.91, its error codes, for a beam without return."""
RANGE_MIN = 0.1
SIGMA_RANGE = 0.01
"""SICK lasers resolve one centimetre [m]."""
MOUNT_TOLERANCE = 2e-3
"""Laser and robot poses are logged apart: their difference is a mount if it stays within this [m, rad]."""

LASERS = (
    "FLASER", "ROBOTLASER1", "RAWLASER1", "RLASER", "ROBOTLASER2", "RAWLASER2", "RAWLASER3", "RAWLASER4"
)  # fmt: skip
"""Messages of scans; the first of them that a log has is read."""
MESSAGE = re.compile(rf"^({'|'.join(LASERS)}|ODOM|PARAM|SYNC)\b", re.MULTILINE)
LASER = re.compile(rf"^({'|'.join(LASERS)}) ", re.MULTILINE)
NAMES = ("ODOM", *LASERS, "TRUEPOS", "IMU")
LENGTHS = {"ODOM": 10, "TRUEPOS": 10, "IMU": 17}
"""Words of a line, its name included."""
DEAD_RECKONING, RANGE_MINIMUM = "slamstitch_dead_reckoning", "slamstitch_range_min"
MOUNT = ("robot_frontlaser_offset", "robot_frontlaser_side_offset", "robot_frontlaser_angular_offset")
"""CARMEN's own parameters for x, y [m] and yaw [rad] of the front laser."""
RANGE_DECIMALS = 3


@dataclass
class _Log:
    """What the lines of one log said so far."""

    path: Path
    laser: str
    odometry: list[list[float]] = field(default_factory=list)  # stamp, x, y, theta
    rows: list[list[float]] = field(default_factory=list)
    lines: list[int] = field(default_factory=list)
    scans: list[list[float]] = field(default_factory=list)  # stamp, laser's x y theta, robot's, if stated
    scan_row: list[int] = field(default_factory=list)
    geometry: list[float] | None = None  # as stated: start, field of view, resolution, maximum, accuracy
    tail: int | None = None  # values after a FLASER's ranges
    mount: dict[str, float] = field(default_factory=dict)
    truth: PoseRecords = field(default_factory=PoseRecords)
    attitude: PoseRecords = field(default_factory=PoseRecords)
    source: Source = "odometry"
    range_min: float = RANGE_MIN


def recognise(file: File) -> bool:
    """Whether a line begins as one of CARMEN's messages."""
    return MESSAGE.search(file.text) is not None


def read(source: File | str | PathLike[str]) -> Recording:
    """Read a CARMEN log, plain or compressed.

    Reads the first of `LASERS` that there is. Each scan's dead reckoning is the robot pose on its own line;
    ``RAWLASER`` has none, there it is interpolated between the ``ODOM`` lines. Raises `FormatError` naming
    file and line.
    """
    file = File.of(source)
    path, log = file.path, _read_log(file)
    ranges, kept = range_matrix(log.rows, log.lines, path)
    time, full_rate = np.array([scan[0] for scan in log.scans]), _full_rate(log)
    poses = np.array(log.scans)[:, 4:7] if _has_poses(log) else _odometry_at(log, time)
    laser = _laser(log)
    ranges[(ranges >= laser.range_max) | (ranges < laser.range_min)] = np.nan
    attitude = None
    if log.source != "odometry" and log.attitude.times:
        attitude = log.attitude.at_scans(time)
    if log.source == "none" and np.any(poses != poses[0]):
        raise FormatError(f"{DEAD_RECKONING} is 'none', expected one robot pose in all scans", path)
    angles, why = _angles(log, ranges, poses, file.field_of_view)
    notes = [f"{log.laser}, {fov.describe(angles)} ({why})"]
    present = set(LASER.findall(file.text))
    if len(present) > 1:
        notes.append(
            f"left out {', '.join(name for name in LASERS if name in present and name != log.laser)}"
        )
    recording = Recording(
        name=recording_name(path),
        time=time,
        ranges=ranges,
        angles=angles,
        laser=laser,
        dead_reckoning=poses,
        source=log.source if _has_poses(log) or log.odometry else "none",
        odometry=full_rate,
        attitude=attitude,
        truth=log.truth.at_scans(time) if log.truth.times else None,
        notes=tuple(notes),
    ).with_scans(kept)
    if log.mount and not _has_poses(log):  # the poses would have told
        recording = recording.with_laser_mount(np.array([log.mount.get(name, 0.0) for name in MOUNT]))
    return recording


def _read_log(file: File) -> _Log:
    """What all lines of a log say. Raises `FormatError`."""
    _check_last_line(file.text, file.path)
    present = set(LASER.findall(file.text))
    log = _Log(file.path, next((name for name in LASERS if name in present), LASERS[0]))
    for number, line in file.lines():
        if line.startswith(log.laser + " "):
            _read_scan(log, line.split(), number)
        elif line.startswith(("ODOM ", "TRUEPOS ", "IMU ")):
            _read_record(log, line.split(), number)
        elif line.startswith("PARAM "):
            _read_parameter(log, line.split(), number)
    return log


def read_trajectory(source: File | str | PathLike[str]) -> Trajectory:
    """The poses of the laser at the scans of a log that some system corrected: they are on the scans' lines.

    Raises `FormatError` naming file and line, and for a log whose scans state no poses.
    """
    file = File.of(source)
    log = _read_log(file)
    if not log.scans:
        raise FormatError("no scans, expected their corrected poses", file.path)
    if not _has_poses(log):
        raise FormatError(f"{log.laser} states no pose, expected the corrected ones", file.path)
    scans = np.array(log.scans)
    poses = np.column_stack([scans[:, 1:3], se2.wrap(scans[:, 3])])
    return Trajectory(scans[:, 0], poses, body="laser")


def odometry_of(source: File | str | PathLike[str]) -> Odometry:
    """The odometry of a log at its full rate, the scans' lines included, with the rows of the scans that
    `read` keeps. Raises `FormatError` as `read` does, and for a log whose scans state no poses."""
    file = File.of(source)
    log = _read_log(file)
    _, kept = range_matrix(log.rows, log.lines, file.path)
    if not _has_poses(log):
        raise FormatError(f"{log.laser} states no pose that could be corrected", file.path)
    records = np.array(log.odometry)
    return Odometry(records[:, 0], records[:, 1:], np.array(log.scan_row)[kept])


def write_corrected(
    path: str | PathLike[str], source: File | str | PathLike[str], poses: Array, T_robot_laser: Array
) -> None:
    """Write every line of the log ``source`` with corrected poses, as Freiburg's metricEvaluator reads it.

    ``poses (M, 3)`` are the robot's at the rows of `odometry_of`. A scan's line gets the pose of its
    laser, mounted at ``T_robot_laser (3,)``, and that of the robot, an ODOM line the robot's; a line of
    another laser those of the record before it, with the mount that it states. All else stays as it is.
    Raises `FormatError` as `odometry_of` does, ``ValueError`` for another number of poses.
    """
    file = File.of(source)
    log = _read_log(file)
    if len(poses) != len(log.odometry):
        raise ValueError(f"corrected log: expected {len(log.odometry)} poses, got {len(poses)}")
    text, row, scan = [], -1, 0
    for number, line in file.lines():
        words = line.split()
        if line.startswith(log.laser + " "):
            row, scan = log.scan_row[scan], scan + 1
            start = _poses_at(words)
            words[start : start + 6] = _spaced(*se2.compose(poses[row], T_robot_laser), *poses[row]).split()
            line = " ".join(words)
        elif row >= 0 and words and words[0] in LASERS and not words[0].startswith("RAWLASER"):
            start = _poses_at(words)
            logged = numbers(words[start : start + 6], words[0], file.path, number)
            mount = se2.between(logged[3:], logged[:3])
            words[start : start + 6] = _spaced(*se2.compose(poses[row], mount), *poses[row]).split()
            line = " ".join(words)
        elif line.startswith("ODOM "):
            row += 1
            words[1:4] = _spaced(*poses[row]).split()
            line = " ".join(words)
        text.append(line)
    Path(path).write_text("\n".join(text), encoding="utf-8")


def _poses_at(words: list[str]) -> int:
    """Index of the first word of the two poses in a scan's line."""
    if words[0] in ("FLASER", "RLASER"):
        return 2 + int(words[1])
    remissions = 9 + int(words[8])
    return remissions + 1 + int(words[remissions])


def _has_poses(log: _Log) -> bool:
    """Whether the lines of scans state where the robot was."""
    return not log.laser.startswith("RAWLASER")


def _full_rate(log: _Log) -> Odometry | None:
    """The odometry between the scans, where there is more of it than scans."""
    if len(log.odometry) <= len(log.scans):
        return None
    odometry = np.array(log.odometry)
    return Odometry(time=odometry[:, 0], poses=odometry[:, 1:], scan_row=np.maximum(log.scan_row, 0))


def _odometry_at(log: _Log, time: Array) -> Array:
    """Poses ``(N, 3)`` at the scans, between the ODOM lines before and after each; zero without any."""
    if not log.odometry:
        return np.zeros((len(time), 3))
    records = PoseRecords([row[0] for row in log.odometry], [row[1:] for row in log.odometry])
    records.before_scan = [row + 1 for row in log.scan_row]
    return records.at_scans(time)


def write(path: str | PathLike[str], recording: Recording) -> None:
    """Write a log that `read` gives back: ranges to the millimetre, all else to six decimals.

    A beam without return prints the maximum range. Scans are ``ROBOTLASER1``, which states the beams' angles;
    relations go to a file of their own. Raises ``ValueError`` for beams that are not evenly spaced.
    """
    geometry = _geometry(recording)
    ranges = printable_ranges(recording.ranges, recording.laser, RANGE_DECIMALS)
    lines = [
        f"# {recording.name}, written by slamstitch",
        "# message_name [message contents] ipc_timestamp ipc_hostname logger_timestamp",
        f"PARAM {DEAD_RECKONING} {recording.source} 0 slamstitch 0",
        f"PARAM {RANGE_MINIMUM} {recording.laser.range_min!r} 0 slamstitch 0",
    ]
    logged, full_rate = 0, recording.full_rate
    for k, stamp in enumerate(recording.time.tolist()):
        if full_rate is not None:
            upto = int(full_rate.scan_row[k]) + 1
            lines += _odometry_lines(full_rate, logged, upto)
            logged = max(logged, upto)
        lines += _pose_lines(recording, k, stamp)
        beams = " ".join([f"{r:.{RANGE_DECIMALS}f}" for r in ranges[k].tolist()])
        laser = se2.compose(recording.dead_reckoning[k], recording.laser.T_robot_laser)
        poses = _spaced(*laser, *recording.dead_reckoning[k])
        lines.append(f"ROBOTLASER1 {geometry} {beams} 0 {poses} 0 0 0 0 0 {_stamped(stamp)}")
    if full_rate is not None:
        lines += _odometry_lines(full_rate, logged, len(full_rate.time))
    Path(path).write_text("\n".join(lines) + "\n", encoding="utf-8")


def _geometry(recording: Recording) -> str:
    """``type start fov resolution max accuracy mode n`` of the laser."""
    angles, laser = recording.angles, recording.laser
    step = float(angles[-1] - angles[0]) / max(len(angles) - 1, 1)
    if not np.allclose(np.diff(angles), step):
        raise ValueError("a CARMEN log needs evenly spaced beams")
    shape = f"{angles[0]:.10f} {angles[-1] - angles[0]:.10f} {step:.10f}"
    return f"0 {shape} {laser.range_max:.6f} {laser.sigma_range:.8f} 0 {len(angles)}"


def _odometry_lines(odometry: Odometry, start: int, stop: int) -> list[str]:
    rows = zip(odometry.time[start:stop].tolist(), odometry.poses[start:stop].tolist(), strict=True)
    return [f"ODOM {_spaced(*pose)} 0 0 0 {_stamped(stamp)}" for stamp, pose in rows]


def _pose_lines(recording: Recording, k: int, stamp: float) -> list[str]:
    """TRUEPOS and IMU of a scan, as far as there are truth and attitude."""
    lines = []
    if recording.truth is not None:
        poses = _spaced(*recording.truth[k], *recording.dead_reckoning[k])
        lines.append(f"TRUEPOS {poses} {_stamped(stamp)}")
    if recording.source != "odometry" and recording.attitude is not None:
        roll, pitch = recording.attitude[k].tolist()
        turned = _spaced(*quaternion.from_angles(roll, pitch, float(recording.dead_reckoning[k, 2])))
        lines.append(f"IMU 0 0 0 {turned} 0 0 0 0 0 0 {_stamped(stamp)}")
    return lines


def _spaced(*values: float) -> str:
    return " ".join([f"{value:.6f}" for value in values])


def _stamped(stamp: float) -> str:
    return f"{stamp:.6f} slamstitch {stamp:.6f}"


def _read_record(log: _Log, words: list[str], line: int) -> None:
    """``ODOM x y theta tv rv accel``, ``TRUEPOS`` true x y theta and odometry's, or ``IMU``: 3 accelerations,
    a quaternion (w, x, y, z), 3 magnetic fields, 3 rates; then the stamp.
    """
    name, expected = words[0], LENGTHS[words[0]]
    if len(words) != expected:
        message = f"{name} of {len(words) - 1} values, expected {expected - 1}: cut in the middle?"
        raise FormatError(message, log.path, line)
    values = numbers([*words[1:-3], words[-3]], name, log.path, line)
    if name == "ODOM":
        log.odometry.append([values[-1], *values[:3]])
    elif name == "TRUEPOS":
        log.truth.add(values[-1], values[:3])
    else:
        if not any(values[3:7]):
            raise FormatError("IMU quaternion is zero, expected a rotation", log.path, line)
        log.attitude.add(values[-1], list(quaternion.roll_pitch(*values[3:7])))


def _read_parameter(log: _Log, words: list[str], line: int) -> None:
    """What `write` adds to the log: whose the dead reckoning is, and the smallest range; and the mount."""
    if words[1:2] and words[1] not in (DEAD_RECKONING, RANGE_MINIMUM, *MOUNT):
        return
    if len(words) < 3:
        raise FormatError(f"PARAM of {len(words) - 1} values, expected a name and a value", log.path, line)
    if words[1] == DEAD_RECKONING:
        if words[2] not in get_args(Source):
            message = f"{DEAD_RECKONING} is {words[2][:20]!r}, expected one of {', '.join(get_args(Source))}"
            raise FormatError(message, log.path, line)
        log.source = words[2]  # type: ignore[assignment]  # just checked
    elif words[1] == RANGE_MINIMUM:
        log.range_min = numbers(words[2:3], RANGE_MINIMUM, log.path, line)[0]
    else:
        log.mount[words[1]] = numbers(words[2:3], words[1], log.path, line)[0]


def _read_scan(log: _Log, words: list[str], line: int) -> None:
    """Append a scan, and its robot pose to the odometry unless an ODOM line just before had that stamp."""
    read_words = _flaser if words[0] in ("FLASER", "RLASER") else _stated_laser
    ranges, stamp, poses = read_words(log, words, line)
    log.rows.append(ranges)
    log.lines.append(line)
    log.scans.append([stamp, *poses])
    if poses and (not log.odometry or log.odometry[-1][0] != stamp):
        log.odometry.append([stamp, *poses[3:]])
    log.scan_row.append(len(log.odometry) - 1)
    log.truth.scan()
    log.attitude.scan()


_Scan = tuple[list[float], float, list[float]]
"""Ranges, stamp, and the poses of laser and robot, or none."""


def _flaser(log: _Log, words: list[str], line: int) -> _Scan:
    """``n r1..rn``, two poses, stamp, host, logger's stamp; some logs leave out the last two."""
    name, path = words[0], log.path
    count = _count(words, 1, name, path, line)
    tail = len(words) - count - 2
    if tail != 9 and (tail != 7 or log.tail not in (None, 7)):
        values = len(words) - 2
        message = f"{name} of {values} values, expected {count} ranges and 9 more: cut in the middle?"
        raise FormatError(message, path, line)
    log.tail = log.tail or tail
    rest = numbers(words[2 + count : 9 + count], f"{name} pose and stamp", path, line)
    return ranges_of(words[2 : 2 + count], f"{name} range", path, line), rest[6], rest[:6]


def _stated_laser(log: _Log, words: list[str], line: int) -> _Scan:
    """``type start fov resolution max accuracy mode n r1..rn m rem1..m``, then of ``ROBOTLASER`` two poses
    and 5 values; stamp, host, logger's stamp."""
    name, path = words[0], log.path
    count = _count(words, 8, name, path, line)
    remissions = _count(words, 9 + count, f"{name} remission", path, line)
    poses = 10 + count + remissions
    stamp = poses + (11 if _has_poses(log) else 0)
    if len(words) != stamp + 3:
        message = f"{name} of {len(words) - 1} values, expected {stamp + 2}: cut in the middle?"
        raise FormatError(message, path, line)
    if log.geometry is None:
        log.geometry = numbers(words[2:7], f"{name} geometry", path, line)
    pose_words = words[poses : poses + 6] if _has_poses(log) else []
    rest = numbers([*pose_words, words[stamp]], f"{name} pose and stamp", path, line)
    return ranges_of(words[9 : 9 + count], f"{name} range", path, line), rest[-1], rest[:-1]


def _count(words: list[str], index: int, what: str, path: Path, line: int) -> int:
    return whole(words[index] if index < len(words) else "nothing", f"{what} count", path, line)


def _laser(log: _Log) -> Laser:
    """Limits and mount."""
    range_max, sigma = SICK_RANGE_MAX, SIGMA_RANGE
    if log.geometry is not None and log.geometry[3] > log.range_min:
        range_max = min(range_max, log.geometry[3])
    if log.geometry is not None and log.geometry[4] > 0.0:
        sigma = log.geometry[4]
    if not 0.0 <= log.range_min < range_max:
        message = f"smallest range {log.range_min:g}, largest {range_max:g}, expected 0 <= smallest < largest"
        raise FormatError(message, log.path)
    return Laser(log.range_min, range_max, sigma, _mount(log))


def _mount(log: _Log) -> Array:
    """What separates laser and robot pose, where that stays constant; zero without poses."""
    if not _has_poses(log):
        return np.zeros(3)
    scans = np.array(log.scans)
    T_robot_laser = se2.between(scans[:, 4:7], scans[:, 1:4])
    mount = T_robot_laser[0]
    spread = np.abs(se2.between(mount, T_robot_laser)).max()
    if spread > MOUNT_TOLERANCE or np.abs(mount).max() < MOUNT_TOLERANCE:
        mount = np.zeros(3)
    return mount


def _angles(log: _Log, ranges: Array, poses: Array, stated: float | None) -> tuple[Array, str]:
    """Beam angles ``(B,)``: as the user ``stated`` [degrees], as the log states, or as the scans tell; and
    which of these."""
    beams = ranges.shape[1]
    if stated is not None:
        return fov.angles(beams, stated), "--field-of-view"
    if log.geometry is not None:
        start, field_of_view, resolution = log.geometry[:3]
        if resolution <= 0.0:
            resolution = field_of_view / max(beams - 1, 1)
        if not 0.0 < resolution * (beams - 1) < 6.3:
            message = f"{log.laser} of {beams} beams {resolution:g} rad apart, expected less than a full turn"
            raise FormatError(message, log.path, log.lines[0])
        return start + resolution * np.arange(beams, dtype=np.float64), "stated"
    known = fov.field_of_view(ranges, poses)
    if known is None:
        message = (
            f"{log.laser} of {beams} beams does not state its field of view: state it, --field-of-view DEG"
        )
        raise FormatError(message, log.path, log.lines[0])
    degrees, certain = known
    taken = "as one scan fits the next" if certain else "as usual: --field-of-view states another"
    return fov.angles(beams, degrees), f"not stated, taken {taken}"


def _check_last_line(text: str, path: Path) -> None:
    """A log cut in its last line has no newline there; a cut keyword would pass as an unknown message."""
    head, _, last = text.rpartition("\n")
    if last and any(name.startswith(last) for name in NAMES):
        line = head.count("\n") + 2 if head else 1
        raise FormatError(f"line ends in {last!r}, expected a message: cut in the middle?", path, line)
