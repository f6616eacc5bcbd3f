"""Logs of the UvA Rescue Team's commander, driving robots in USARSim.

Lines like ``SEN {Time 6063.1} {Type GroundTruth} {Location x,y,z} {Orientation roll,pitch,yaw}``. USARSim's
axes are x forward, y right, z down; here y, yaw and pitch change sign. Beams are printed from right to left,
which is counter-clockwise. Ranges are cut off after their last digit, not rounded (``FloatString`` of
USARSim's UnitsConverter.uc); walls seen at a slant show it: 6.7 ± 0.2 mm too near in a log of two decimals.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from os import PathLike
from pathlib import Path
from typing import NoReturn

import numpy as np

from slam.formats import field_of_view as fov
from slam.formats.pose_records import PoseRecords
from slam.formats.text import (
    File,
    FormatError,
    numbers,
    printable_ranges,
    range_matrix,
    ranges_of,
    recording_name,
)
from slam.recording import Laser, Recording, Source
from slam.se2 import Array, rotation, wrap

ROTATOR_UNIT = np.pi / 32768.0
"""The Unreal engine counts angles in whole steps of this size [rad]."""
DEFAULT_LIMITS = {"MinRange": 0.1, "MaxRange": 20.0}
"""Limits [m] of USARSim's standard range scanner, for logs without a CONF line."""
RANGE_NOISE = 1e-3
"""Older scanners, which have no CONF line, print a beam without return as the maximum range less up to this
share of it."""
SIGMA_RANGE = 0.01
"""Ranges are printed with two decimals [m]; our own logs say in CONF how noisy they are."""
RANGE_DECIMALS = 3
NEAREST = "nearest"
"""How our own logs round their ranges, as CONF says."""
SCANNER = "Scanner1"
"""What our own logs call the laser."""

CLOCK = r"(?:[\d:.,TZ/()\[\]-]+ +){0,2}"
"""Some logs begin each line with the time of the computer that wrote it."""
MESSAGE = re.compile(rf"^(# UvA Rescue Team|{CLOCK}(SEN|STA|MISSTA|GEO|CONF|NFO|INIT) \{{)", re.MULTILINE)
LEADING_CLOCK = re.compile(rf"^{CLOCK}(?=[A-Z]+ \{{)")
TORN_LINE = "line ends in {!r}, expected a closing brace: cut in the middle?"
FIELD = re.compile(r"\{(\w+) +([^{}]*)\}")
TIME = re.compile(r"\{Time +([^{} ]+) *\}")
POSE_FIELDS = {
    "GroundTruth": ("Location", "Orientation"),
    "INS": ("Location", "Orientation"),
    "Odometry": ("Pose",),
}
FLIP = {6: np.array([1.0, -1.0, -1.0, 1.0, -1.0, -1.0]), 3: np.array([1.0, -1.0, -1.0])}
"""From y right, z down to y left, z up: of (x, y, z, roll, pitch, yaw) and of (x, y, yaw)."""


@dataclass
class _Log:
    """What the lines of one log said so far."""

    path: Path
    now: float = np.nan
    spawn_yaw: float = 0.0
    scanner: str | None = None
    silent: set[str] = field(default_factory=set)  # further scanners
    scan: dict[str, str] = field(default_factory=dict)
    scan_times: list[float] = field(default_factory=list)
    scan_lines: list[int] = field(default_factory=list)
    rows: list[list[float]] = field(default_factory=list)
    poses: dict[str, PoseRecords] = field(
        default_factory=lambda: {kind: PoseRecords() for kind in POSE_FIELDS}
    )
    devices: dict[str, dict[str, tuple[int, str]]] = field(default_factory=dict)


def recognise(file: File) -> bool:
    """Whether a line begins as one of USARSim's messages, or as the commander's header."""
    return MESSAGE.search(file.text) is not None


def read(source: File | str | PathLike[str]) -> Recording:
    """Read a USARSim log, plain or compressed.

    Dead reckoning is the INS where there is one, else the odometry, interpolated in time at the scans. Of a
    robot with several range scanners the first to speak is read. Raises `FormatError` naming file and line.
    """
    file = File.of(source)
    path = file.path
    log = _Log(path)
    for number, line in file.lines():
        _read_line(log, line, number)
    _check_last_line(file.text, path)
    ranges, kept = range_matrix(log.rows, log.scan_lines, path)
    time = _scan_times(log)
    laser = _laser(log)
    stated = "MaxRange" in log.devices.get(log.scanner or "", {})
    farthest = laser.range_max if stated else (1.0 - RANGE_NOISE) * laser.range_max
    ranges[(ranges >= farthest) | (ranges < laser.range_min)] = np.nan
    ranges += _cut_off(log)
    source, reckoned = _dead_reckoning(log, time)
    angles = _angles(log, ranges.shape[1], file.field_of_view)
    why = "stated" if file.field_of_view is None else "--field-of-view"
    notes = [f"range scanner {log.scanner or 'without a name'}, {fov.describe(angles)} ({why})"]
    if log.silent:
        notes.append(f"left out {', '.join(sorted(log.silent))}")
    truth = log.poses["GroundTruth"]
    return Recording(
        name=recording_name(path),
        time=time,
        ranges=ranges,
        angles=angles,
        laser=laser,
        dead_reckoning=_planar(reckoned),
        source=source,
        attitude=reckoned[:, 3:5] if source == "ins" else None,
        truth=_planar(truth.at_scans(time)) if truth.times else None,
        notes=tuple(notes),
    ).with_scans(kept)


def write(path: str | PathLike[str], recording: Recording) -> None:
    """Write a log that `read` gives back: ranges to the millimetre, all else to six decimals.

    A beam without return prints the maximum range. Not kept: full-rate odometry, relations, and the attitude
    of a recording without INS. Raises ``ValueError`` for beams that the format cannot say: fewer than two,
    unevenly spaced, or none to the right.
    """
    fov, step = _field_of_view(recording.angles)
    ranges = printable_ranges(recording.ranges, recording.laser, RANGE_DECIMALS)
    shape = f"{{Name {SCANNER}}} {{Resolution {step:.10f}}} {{FOV {fov:.10f}}}"
    lines = _header(recording)
    for k, time in enumerate(recording.time.tolist()):
        stamp = f"{{Time {time:.6f}}}"
        if recording.truth is not None:
            x, y, yaw = recording.truth[k]
            lines.append(_pose_line(stamp, "GroundTruth", (x, y, 0.0, 0.0, 0.0, yaw)))
        if recording.source != "none":
            lines.append(_dead_reckoning_line(stamp, recording, k))
        beams = ",".join([f"{r:.{RANGE_DECIMALS}f}" for r in ranges[k].tolist()])
        lines.append(f"SEN {stamp} {{Type RangeScanner}} {shape} {{Range {beams}}}")
    Path(path).write_text("\n".join(lines) + "\n", encoding="utf-8")


def _field_of_view(angles: Array) -> tuple[float, float]:
    """Field of view and step [rad] of evenly spaced beams from -FOV/2 up."""
    if len(angles) < 2 or not np.allclose(np.diff(angles), (angles[-1] - angles[0]) / (len(angles) - 1)):
        raise ValueError("a USARSim log needs at least two beams, evenly spaced")
    if not angles[0] < 0.0:
        raise ValueError(f"a USARSim log needs its first beam to the right, got {angles[0]:g} rad")
    return -2.0 * float(angles[0]), float(angles[-1] - angles[0]) / (len(angles) - 1)


def _header(recording: Recording) -> list[str]:
    """Spawn pose, and the laser's mount, which USARSim prints along the world's axes."""
    laser = recording.laser
    start = (recording.dead_reckoning if recording.truth is None else recording.truth)[0]
    x, y, yaw = FLIP[3] * start
    mount = FLIP[3] * laser.T_robot_laser
    mx, my = rotation(yaw) @ mount[:2]
    limits = f"{{MaxRange {laser.range_max:.6f}}} {{MinRange {laser.range_min:.6f}}}"
    return [
        "# UvA Rescue Team Logfile",
        f"# {recording.name}, written by slamstitch",
        "",
        f"INIT {{ClassName USARBot.kenaf}} {{Name Robot1}} {{Location {x:.6f},{y:.6f},0.000000}}"
        f" {{Rotation 0.000000,0.000000,{yaw:.6f}}}",
        f"GEO {{Type RangeScanner}} {{Name {SCANNER}}} {{Location {mx:.6f},{my:.6f},0.000000}}"
        f" {{Orientation 0.000000,0.000000,{mount[2]:.6f}}}",
        f"CONF {{Type RangeScanner}} {{Name {SCANNER}}} {limits} {{SigmaRange {laser.sigma_range:.8f}}}"
        f" {{Rounding {NEAREST}}}",
    ]


def _dead_reckoning_line(stamp: str, recording: Recording, k: int) -> str:
    x, y, yaw = recording.dead_reckoning[k]
    if recording.source == "odometry":
        x, y, yaw = FLIP[3] * (x, y, yaw)
        return f"SEN {stamp} {{Type Odometry}} {{Name Odometry}} {{Pose {x:.6f},{y:.6f},{yaw:.6f}}}"
    roll, pitch = (0.0, 0.0) if recording.attitude is None else recording.attitude[k]
    return _pose_line(stamp, "INS", (x, y, 0.0, roll, pitch, yaw))


def _pose_line(stamp: str, kind: str, pose: tuple[float, ...]) -> str:
    x, y, z, roll, pitch, yaw = FLIP[6] * pose
    place = f"{{Location {x:.6f},{y:.6f},{z:.6f}}} {{Orientation {roll:.6f},{pitch:.6f},{yaw:.6f}}}"
    return f"SEN {stamp} {{Type {kind}}} {{Name {kind}}} {place}"


def _read_line(log: _Log, line: str, number: int) -> None:
    if line[:1].isdigit() or line[:1] in ("[", "("):
        line = LEADING_CLOCK.sub("", line)
    word = line[:4]
    if word not in ("SEN ", "STA ", "GEO ", "CONF", "INIT", "MISS"):
        return
    if not line.rstrip().endswith("}"):
        _fail(log, number, TORN_LINE.format(line[-20:]))
    stamp = TIME.search(line)
    time = numbers([stamp[1]], "Time", log.path, number)[0] if stamp else log.now
    if not (time < log.now and "{Type RangeScanner}" in line):  # older scanners stamp one tick late
        log.now = time
    if word == "SEN ":
        _read_sensor(log, line, number, time)
    elif word == "INIT":
        rotation_rpy = _devices(line)[1].get("Rotation")
        if rotation_rpy:
            log.spawn_yaw = _triple(log, number, "Rotation", rotation_rpy)[2]
    elif word in ("GEO ", "CONF") and "{Type RangeScanner}" in line:
        for name, entries in _devices(line)[0].items():
            known = log.devices.setdefault(name, {})
            known.update({key: (number, value) for key, value in entries.items()})


def _read_sensor(log: _Log, line: str, number: int, time: float) -> None:
    start = line.find("{Type ")
    if start < 0:
        _fail(log, number, "SEN without {Type ...}")
    kind = line[start + 6 : line.find("}", start)].strip()
    if kind == "RangeScanner":
        _read_scan(log, dict(FIELD.findall(line)), number, time)
    elif kind in POSE_FIELDS:
        fields = dict(FIELD.findall(line))
        poses = log.poses[kind]
        value: list[float] = []
        for key in POSE_FIELDS[kind]:
            value += _triple(log, number, f"{kind} {key}", fields.get(key))
        poses.add(time, (FLIP[len(value)] * value).tolist())


def _read_scan(log: _Log, fields: dict[str, str], number: int, time: float) -> None:
    if "Range" not in fields:
        _fail(log, number, "RangeScanner without {Range r1,r2,...}")
    name = fields.get("Name", "")
    if log.scanner is None:
        log.scanner, log.scan = name, fields
    if name != log.scanner:
        log.silent.add(name)
        return
    log.rows.append(ranges_of(fields["Range"].split(","), "Range", log.path, number))
    log.scan_times.append(time)
    log.scan_lines.append(number)
    for poses in log.poses.values():
        poses.scan()


def _devices(line: str) -> tuple[dict[str, dict[str, str]], dict[str, str]]:
    """Entries per device name and of the whole line: ``{Name A} {Key v}``, formerly ``{Name A Key v}``."""
    words = line.replace("{", " ").replace("}", " ").split()[1:]
    pairs = list(zip(words[::2], words[1::2], strict=False))
    devices: dict[str, dict[str, str]] = {}
    for key, value in pairs:
        if key == "Name":
            current = devices.setdefault(value, {})
        elif devices:
            current[key] = value
    return devices, dict(pairs)


def _scan_times(log: _Log) -> Array:
    """Stamps ``(N,)``; records before the first stamp of the log get that stamp."""
    times = np.array(log.scan_times)
    lists = [log.scan_times, *(poses.times for poses in log.poses.values())]
    first = next((t for t in np.sort(np.concatenate(lists)) if np.isfinite(t)), None)
    if first is None:
        raise FormatError("no time stamps, expected {Time seconds}", log.path)
    for poses in log.poses.values():
        poses.times = [first if np.isnan(t) else t for t in poses.times]
    return np.where(np.isnan(times), first, times)


def _dead_reckoning(log: _Log, time: Array) -> tuple[Source, Array]:
    if log.poses["INS"].times:
        return "ins", log.poses["INS"].at_scans(time)
    if log.poses["Odometry"].times:
        return "odometry", log.poses["Odometry"].at_scans(time)
    return "none", np.zeros((len(time), 3))


def _planar(values: Array) -> Array:
    """``(N, 3)`` x, y, yaw of ``(N, 3)`` or of x, y, z, roll, pitch, yaw ``(N, 6)``."""
    return values if values.shape[1] == 3 else values[:, [0, 1, 5]]


def _laser(log: _Log) -> Laser:
    """Limits from CONF, mount from GEO, which prints the offset along the world's axes at the spawn pose."""
    known = log.devices.get(log.scanner or "", {})
    limits = {**DEFAULT_LIMITS, "SigmaRange": SIGMA_RANGE}
    for key in limits.keys() & known.keys():
        line, value = known[key]
        limits[key] = numbers([value], key, log.path, line)[0]
    low, high = limits["MinRange"], limits["MaxRange"]
    if not 0.0 <= low < high:
        raise FormatError(f"MinRange {low:g}, MaxRange {high:g}, expected 0 <= MinRange < MaxRange", log.path)
    if not limits["SigmaRange"] > 0.0:
        raise FormatError(f"SigmaRange {limits['SigmaRange']:g}, expected metres > 0", log.path)
    mount = np.zeros(3)
    if "Location" in known:
        line, location = known["Location"]
        offset = np.array(_triple(log, line, "Location", location)[:2])
        mount[:2] = (rotation(-log.spawn_yaw) @ offset) * (1.0, -1.0)
    if "Orientation" in known:
        line, orientation = known["Orientation"]
        mount[2] = -wrap(_triple(log, line, "Orientation", orientation)[2])
    mount = np.round(mount, 4) + 0.0  # as many decimals as are printed; never -0.0
    return Laser(range_min=low, range_max=high, sigma_range=limits["SigmaRange"], T_robot_laser=mount)


def _cut_off(log: _Log) -> float:
    """What printing takes from a range [m]: half the last digit on average."""
    if log.devices.get(log.scanner or "", {}).get("Rounding", (0, ""))[1] == NEAREST:
        return 0.0
    printed = [word.strip().partition(".")[2] for word in log.scan["Range"].split(",")]
    decimals = max((len(digits) for digits in printed if digits.isdigit()), default=0)
    return 0.5 * 10.0**-decimals if decimals else 0.0


def _angles(log: _Log, beams: int, stated: float | None) -> Array:
    """Beam angles ``(B,)``, from -FOV/2 up; a FOV beyond a full turn of radians is in degrees.

    The simulator steps by a whole number of rotator units until it passes +FOV/2, so the last beam may fall
    short of it. The printed Resolution is rounded: the step is the one that gives this many beams. Our own
    logs print it in full. What the user ``stated`` [degrees] comes first.
    """
    line = log.scan_lines[0]
    if stated is not None:
        return fov.angles(beams, stated)
    name = next((name for name in ("FOV", "Fov") if name in log.scan), None)
    if name is None:
        _fail(log, line, "RangeScanner without {FOV radians}: state it, --field-of-view DEG")
    field_of_view = numbers([log.scan[name]], name, log.path, line)[0]
    if 6.3 <= field_of_view <= 360.0:
        return np.linspace(-0.5, 0.5, beams) * np.radians(field_of_view)
    if beams < 2 or not 0.0 < field_of_view < 6.3:
        spread = f"{beams} beams over {field_of_view:g} rad"
        _fail(log, line, f"{spread}, expected at least 2 over at most a full turn")
    if "Resolution" in log.scan:
        printed = numbers([log.scan["Resolution"]], "Resolution", log.path, line)[0]
        if len(log.scan["Resolution"].partition(".")[2]) > 4 and 0.0 < printed * (beams - 1) < 6.3:
            return -0.5 * field_of_view + printed * np.arange(beams)
        around = np.arange(np.ceil((printed - 5e-5) / ROTATOR_UNIT), (printed + 5e-5) / ROTATOR_UNIT)
        for step in around[around > 0] * ROTATOR_UNIT:
            if int(field_of_view / step) + 1 == beams:
                return -0.5 * field_of_view + step * np.arange(beams)
    return np.linspace(-0.5 * field_of_view, 0.5 * field_of_view, beams)


def _triple(log: _Log, line: int, what: str, text: str | None) -> list[float]:
    words = [] if text is None else text.split(",")
    if len(words) != 3:
        _fail(log, line, f"{what}: {len(words)} values, expected 3")
    return numbers(words, what, log.path, line)


def _check_last_line(text: str, path: Path) -> None:
    """A log cut in the middle of a line has no newline at its end, and no closing brace either."""
    head, _, last = text.rpartition("\n")
    if last.strip() and not last.startswith("#") and not last.rstrip().endswith("}"):
        line = head.count("\n") + 2 if head else 1
        raise FormatError(TORN_LINE.format(last[-20:]), path, line)


def _fail(log: _Log, line: int, message: str) -> NoReturn:
    raise FormatError(message, log.path, line)
