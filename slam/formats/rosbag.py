"""ROS 2 bags, sqlite3 or mcap: ``LaserScan``, ``Odometry`` and static transforms, read and written.

Both need the package rosbags, which is pure Python. Axes are those of REP 103, like ours.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from os import PathLike
from pathlib import Path
from typing import Any, Literal

import numpy as np

from slam.formats import quaternion
from slam.formats.pose_records import PoseRecords
from slam.formats.text import File, FormatError, recording_name
from slam.recording import Laser, Odometry, Recording, Source
from slam.se2 import Array

HOW_TO_INSTALL = "a ROS 2 bag needs the package rosbags: pip install 'slamstitch[ros]'"
SUFFIXES = (".db3", ".mcap")
SCAN_TYPE, ODOMETRY_TYPE = "sensor_msgs/msg/LaserScan", "nav_msgs/msg/Odometry"
TF_TYPE, IMU_TYPE = "tf2_msgs/msg/TFMessage", "sensor_msgs/msg/Imu"
SCAN, INS, ODOMETRY, TRUTH, ATTITUDE = "/scan", "/ins", "/odom", "/ground_truth", "/imu"
TF, TF_STATIC = "/tf", "/tf_static"
OPTIONAL = ((TRUTH, ODOMETRY_TYPE), (ATTITUDE, IMU_TYPE), (TF_STATIC, TF_TYPE))
TYPES = {
    SCAN: SCAN_TYPE, INS: ODOMETRY_TYPE, ODOMETRY: ODOMETRY_TYPE, TRUTH: ODOMETRY_TYPE, ATTITUDE: IMU_TYPE,
    TF: TF_TYPE, TF_STATIC: TF_TYPE,
}  # fmt: skip
"""Of the topics that we write."""
WORLD, START, BASE, LASER = "map", "odom", "base_link", "laser"
"""Frames: of the truth, of the dead reckoning, of the robot, of the laser."""
VERSION: Literal[8] = 8
"""Of the bag format: that of ROS 2 Iron, which Jazzy and later read too."""
LEVEL = np.deg2rad(5.0)
"""A laser mounted with more tilt than this [rad] does not see the plane."""
RANGE_DECIMALS, ANGLE_DECIMALS = 5, 6
"""Messages hold 32-bit floats; so many of their decimals mean something."""


def recognise(file: File) -> bool:
    """Whether it is a folder with a metadata.yaml, or a file that is named as a bag's storage."""
    path = file.path
    return (path / "metadata.yaml").is_file() or (path.suffix in SUFFIXES and path.is_file())


@dataclass
class _Bag:
    """What the messages of one bag said so far."""

    path: Path
    source: Source = "odometry"
    times: list[float] = field(default_factory=list)
    rows: list[Array] = field(default_factory=list)
    scan: Any = None  # the first LaserScan
    base: str = ""
    reckoned: PoseRecords = field(default_factory=PoseRecords)
    truth: PoseRecords = field(default_factory=PoseRecords)
    attitude: PoseRecords = field(default_factory=PoseRecords)
    parents: dict[str, tuple[str, Array]] = field(default_factory=dict)  # child -> parent, T (4, 4)


def read(source: File | str | PathLike[str]) -> Recording:
    """Read a bag: its folder, or its .db3 or .mcap file.

    Of several topics of one type that of our own bags is read, else the first by name; ``/ground_truth`` is
    the truth, ``/ins`` the dead reckoning of an INS. It is interpolated at the scans, and kept at its full
    rate where there is more of it. The mount comes from ``/tf_static``, and is zero where that does not lead
    from the laser to the robot. Without any odometry there is no dead reckoning. Raises `FormatError`.
    """
    path = File.of(source).path
    bag = _Bag(path)
    for topic, message in _messages(path):
        _take(bag, topic, message)
    if bag.scan is None:
        raise FormatError(f"no {SCAN_TYPE}, expected at least one", path)
    if not bag.reckoned.times:
        bag.source = "none"
    time, angles = np.array(bag.times), _angles(bag.scan)
    order = np.argsort(angles)
    try:
        return Recording(
            name=recording_name(path),
            time=time,
            ranges=_ranges(bag)[:, order],
            angles=angles[order],
            laser=_laser(bag),
            dead_reckoning=bag.reckoned.at_scans(time) if bag.reckoned.times else np.zeros((len(time), 3)),
            source=bag.source,
            odometry=_full_rate(bag.reckoned, len(time)),
            attitude=bag.attitude.at_scans(time) if bag.source != "odometry" and bag.attitude.times else None,
            truth=bag.truth.at_scans(time) if bag.truth.times else None,
        )
    except FormatError:
        raise
    except ValueError as error:
        raise FormatError(str(error), path) from None


def _messages(path: Path) -> Iterator[tuple[str, Any]]:
    """Every message that says something about the recording, in the order of logging, with its topic."""
    rosbag2, typestore = _rosbags(path)
    try:
        with rosbag2.Reader(path) as reader:
            chosen = _topics(reader.connections)
            wanted = [c for c in reader.connections if c.topic in chosen]
            for connection, _, data in reader.messages(wanted) if wanted else ():
                yield chosen[connection.topic], typestore.deserialize_cdr(data, connection.msgtype)
    except Exception as error:  # rosbags lets through whatever its storage engines and parsers raise
        raise FormatError(f"not a readable ROS 2 bag: {error}", path) from error


def _rosbags(path: Path) -> tuple[Any, Any]:
    """The module of bags and the types of ROS 2's own messages. Raises `FormatError` without rosbags."""
    try:
        from rosbags import rosbag2
        from rosbags.typesys import Stores, get_typestore
    except ImportError:
        raise FormatError(HOW_TO_INSTALL, path) from None
    return rosbag2, get_typestore(Stores.ROS2_HUMBLE)


def _topics(connections: list[Any]) -> dict[str, str]:
    """Topics to read, each with the name our own bags give it."""
    named = sorted((c.topic, c.msgtype) for c in connections if c.msgcount)
    scans = [topic for topic, kind in named if kind == SCAN_TYPE]
    odometries = [topic for topic, kind in named if kind == ODOMETRY_TYPE and topic != TRUTH]
    chosen = {topic: topic for topic, kind in named if (topic, kind) in OPTIONAL}
    if scans:
        chosen[SCAN if SCAN in scans else scans[0]] = SCAN
    if INS in odometries:
        chosen[INS] = INS
    elif odometries:
        chosen[ODOMETRY if ODOMETRY in odometries else odometries[0]] = ODOMETRY
    return chosen


def _take(bag: _Bag, topic: str, message: Any) -> None:
    if topic == SCAN:
        _take_scan(bag, message)
    elif topic == TF_STATIC:
        for link in message.transforms:
            T = _transform(link.transform.rotation, link.transform.translation, bag.path)
            bag.parents[_frame(link.child_frame_id)] = (_frame(link.header.frame_id), T)
    elif topic == ATTITUDE:
        q = message.orientation
        bag.attitude.add(_seconds(message.header.stamp), list(quaternion.roll_pitch(q.w, q.x, q.y, q.z)))
    else:
        position, q = message.pose.pose.position, message.pose.pose.orientation
        pose = [position.x, position.y, quaternion.yaw_of(q.w, q.x, q.y, q.z)]
        (bag.truth if topic == TRUTH else bag.reckoned).add(_seconds(message.header.stamp), pose)
        if topic != TRUTH:
            bag.base = _frame(message.child_frame_id)
            bag.source = "ins" if topic == INS else "odometry"


def _take_scan(bag: _Bag, message: Any) -> None:
    bag.scan = bag.scan or message
    expected, beams = len(bag.scan.ranges), len(message.ranges)
    if beams != expected:
        where = f"scan {len(bag.rows) + 1} of {beams} ranges"
        raise FormatError(f"{where}, expected {expected} as in the first scan", bag.path)
    bag.times.append(_seconds(message.header.stamp))
    bag.rows.append(np.asarray(message.ranges, dtype=np.float64))
    for records in (bag.reckoned, bag.truth, bag.attitude):
        records.scan()


def _seconds(stamp: Any) -> float:
    return stamp.sec + 1e-9 * stamp.nanosec


def _frame(name: str) -> str:
    return name.removeprefix("/")


def _transform(rotation: Any, translation: Any, path: Path) -> Array:
    q = (rotation.w, rotation.x, rotation.y, rotation.z)
    if not any(q):
        raise FormatError("static transform with a quaternion of zero, expected a rotation", path)
    T = np.eye(4)
    T[:3, :3] = quaternion.matrix(*q)
    T[:3, 3] = translation.x, translation.y, translation.z
    return T


def _angles(scan: Any) -> Array:
    """Beam angles ``(B,)`` as sent, which may be clockwise."""
    beams = len(scan.ranges)
    first, last = np.round([scan.angle_min, scan.angle_max], ANGLE_DECIMALS)
    if abs(first + scan.angle_increment * (beams - 1) - last) < 0.5 * abs(scan.angle_increment):
        return np.linspace(first, last, beams)
    return first + scan.angle_increment * np.arange(beams)


def _limits(scan: Any) -> tuple[float, float]:
    low, high = np.round([scan.range_min, scan.range_max], RANGE_DECIMALS)
    return float(low), float(high)


def _ranges(bag: _Bag) -> Array:
    """Ranges ``(N, B)`` m, NaN for what REP 117 counts as no return."""
    ranges = np.round(np.array(bag.rows), RANGE_DECIMALS)
    low, high = _limits(bag.scan)
    return np.where((ranges >= low) & (ranges < high), ranges, np.nan)


def _laser(bag: _Bag) -> Laser:
    """Limits from the scan, mount from the static transforms between the robot and the laser."""
    frame, T = _frame(bag.scan.header.frame_id), np.eye(4)
    for _ in range(len(bag.parents)):
        if frame == bag.base or frame not in bag.parents:
            break
        frame, T_parent = bag.parents[frame]
        T = T_parent @ T
    if bag.base and frame != bag.base:
        T = np.eye(4)
    if T[2, 2] < np.cos(LEVEL):
        raise FormatError("the laser is mounted tilted or upside down, expected a level one", bag.path)
    low, high = _limits(bag.scan)
    mount = np.array([T[0, 3], T[1, 3], np.arctan2(T[1, 0], T[0, 0])])
    return Laser(range_min=low, range_max=high, T_robot_laser=mount)


def _full_rate(records: PoseRecords, scans: int) -> Odometry | None:
    if len(records.times) <= scans:
        return None
    rows = np.maximum(np.array(records.before_scan) - 1, 0)
    return Odometry(time=np.array(records.times), poses=np.array(records.values), scan_row=rows)


def write(path: str | PathLike[str], recording: Recording, storage: str = "sqlite3") -> None:
    """Write the folder ``path``: LaserScan, Odometry (``/ins`` or ``/odom``, and the truth), Imu and TF.

    ``storage`` is sqlite3 or mcap. A beam without return is infinite (REP 117); ranges and angles have 32
    bits. Not kept: relations and the laser's noise. Raises `FormatError` without the package rosbags and for
    a folder that exists, ``ValueError`` for beams that are not evenly spaced and for times before 0.
    """
    path = Path(path)
    _check(recording, path)
    rosbag2, types = _rosbags(path)
    plugin = rosbag2.StoragePlugin[storage.upper()]
    logged = -1
    with rosbag2.Writer(path, version=VERSION, storage_plugin=plugin) as writer:
        connections: dict[str, Any] = {}
        for topic, stamp, message in Messages(types.types).of(recording):
            if topic not in connections:
                qos = [_latched()] if topic == TF_STATIC else []
                connections[topic] = writer.add_connection(
                    topic, TYPES[topic], typestore=types, offered_qos_profiles=qos
                )
            logged = max(logged + 1, _nanoseconds(stamp))  # strictly increasing: that is the order of a bag
            writer.write(connections[topic], logged, types.serialize_cdr(message, TYPES[topic]))


def _check(recording: Recording, path: Path) -> None:
    if path.exists():
        raise FormatError("exists already, expected the name of a new folder", path)
    angles = recording.angles
    if len(angles) < 2 or not np.allclose(np.diff(angles), (angles[-1] - angles[0]) / (len(angles) - 1)):
        raise ValueError("a LaserScan needs at least two beams, evenly spaced")
    earliest = recording.time.min() if recording.odometry is None else recording.odometry.time.min()
    if min(earliest, recording.time.min()) < 0.0:
        raise ValueError("a ROS bag needs times >= 0 s")


def _latched() -> Any:
    """What makes a replayed static transform reach those who listen late."""
    from rosbags import interfaces as ros

    never, history, lively = ros.QosTime(0, 0), ros.QosHistory.KEEP_LAST, ros.QosLiveliness.AUTOMATIC
    reliable, durable = ros.QosReliability.RELIABLE, ros.QosDurability.TRANSIENT_LOCAL
    return ros.Qos(history, 1, reliable, durable, never, never, lively, never, False)


def _nanoseconds(stamp: float) -> int:
    return round(stamp * 1e9)


class Messages:
    """Makes ROS messages of a recording's rows."""

    def __init__(self, types: dict[str, Any]) -> None:
        self._types = types

    def of(self, recording: Recording) -> Iterator[tuple[str, float, Any]]:
        """Topic, stamp [s] and message, in the order in which the robot would have logged them."""
        odometry = recording.odometry
        if odometry is None or recording.source == "none":
            odometry = Odometry(recording.time, recording.dead_reckoning, np.arange(len(recording)))
        start = float(recording.time[0])
        yield TF_STATIC, start, self.tf(start, BASE, LASER, recording.laser.T_robot_laser)
        sent = 0
        for k, time in enumerate(recording.time.tolist()):
            upto = max(sent, int(odometry.scan_row[k]) + 1)
            yield from self._motion(recording.source, odometry, sent, upto)
            sent = upto
            if recording.truth is not None:
                yield TRUTH, time, self.odometry(time, WORLD, recording.truth[k])
            if recording.attitude is not None:
                yaw = float(recording.dead_reckoning[k, 2])
                yield ATTITUDE, time, self._imu(time, (*recording.attitude[k].tolist(), yaw))
            yield SCAN, time, self.scan(recording, k)
        yield from self._motion(recording.source, odometry, sent, len(odometry.time))

    def _motion(self, source: str, odometry: Odometry, start: int, stop: int) -> Iterator[Any]:
        if source == "none":
            return
        topic = INS if source == "ins" else ODOMETRY
        for time, pose in zip(odometry.time[start:stop].tolist(), odometry.poses[start:stop], strict=True):
            yield topic, time, self.odometry(time, START, pose)
            yield TF, time, self.tf(time, START, BASE, pose)

    def _make(self, kind: str, *values: Any) -> Any:
        return self._types[kind](*values)

    def _header(self, time: float, frame: str) -> Any:
        seconds, nanoseconds = divmod(_nanoseconds(time), 10**9)
        stamp = self._make("builtin_interfaces/msg/Time", seconds, nanoseconds)
        return self._make("std_msgs/msg/Header", stamp, frame)

    def _vector(self, x: float = 0.0, y: float = 0.0) -> Any:
        return self._make("geometry_msgs/msg/Vector3", x, y, 0.0)

    def _rotation(self, roll: float, pitch: float, yaw: float) -> Any:
        w, x, y, z = quaternion.from_angles(roll, pitch, yaw)
        return self._make("geometry_msgs/msg/Quaternion", x, y, z, w)

    def tf(self, time: float, parent: str, child: str, pose: Array) -> Any:
        """TFMessage of frame ``child`` at ``pose (3,)`` in ``parent``."""
        x, y, yaw = pose.tolist()
        transform = self._make(
            "geometry_msgs/msg/Transform", self._vector(x, y), self._rotation(0.0, 0.0, yaw)
        )
        link = self._make("geometry_msgs/msg/TransformStamped", self._header(time, parent), child, transform)
        return self._make(TF_TYPE, [link])

    def odometry(self, time: float, frame: str, pose: Array) -> Any:
        """Odometry of the robot at ``pose (3,)`` in ``frame``, its covariances unknown."""
        x, y, yaw = pose.tolist()
        place = self._make("geometry_msgs/msg/Point", x, y, 0.0)
        pose_message = self._make("geometry_msgs/msg/Pose", place, self._rotation(0.0, 0.0, yaw))
        still = self._make("geometry_msgs/msg/Twist", self._vector(), self._vector())
        unknown = np.zeros(36)
        return self._make(
            ODOMETRY_TYPE,
            self._header(time, frame),
            BASE,
            self._make("geometry_msgs/msg/PoseWithCovariance", pose_message, unknown),
            self._make("geometry_msgs/msg/TwistWithCovariance", still, unknown),
        )

    def _imu(self, time: float, angles: tuple[float, float, float]) -> Any:
        unknown, absent = np.zeros(9), np.array([-1.0, *[0.0] * 8])
        vector = self._vector()
        header, rotation = self._header(time, BASE), self._rotation(*angles)
        return self._make(IMU_TYPE, header, rotation, unknown, vector, absent, vector, absent)

    def scan(self, recording: Recording, k: int) -> Any:
        """LaserScan of scan k."""
        angles, laser = recording.angles, recording.laser
        ranges = np.where(np.isnan(recording.ranges[k]), np.inf, recording.ranges[k]).astype(np.float32)
        step = float(angles[-1] - angles[0]) / (len(angles) - 1)
        shape = (float(angles[0]), float(angles[-1]), step)
        limits = (laser.range_min, laser.range_max)
        header = self._header(float(recording.time[k]), LASER)
        empty = np.zeros(0, dtype=np.float32)
        return self._make(SCAN_TYPE, header, *shape, 0.0, 0.0, *limits, ranges, empty)
