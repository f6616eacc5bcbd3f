"""A recording → a ROS 2 bag, as a robot would have logged it."""

from __future__ import annotations

from collections.abc import Iterator
from os import PathLike
from pathlib import Path
from typing import Any, Literal

import numpy as np

from slam.formats import quaternion
from slam.formats.rosbag.names import (
    ATTITUDE,
    BASE,
    IMU_TYPE,
    INS,
    LASER,
    ODOMETRY,
    ODOMETRY_TYPE,
    SCAN,
    SCAN_TYPE,
    START,
    TF,
    TF_STATIC,
    TF_TYPE,
    TRUTH,
    WORLD,
)
from slam.formats.rosbag.storage import rosbags, typestore
from slam.formats.text import FormatError
from slam.recording import Odometry, Recording
from slam.se2 import Array

TYPES = {
    SCAN: SCAN_TYPE, INS: ODOMETRY_TYPE, ODOMETRY: ODOMETRY_TYPE, TRUTH: ODOMETRY_TYPE, ATTITUDE: IMU_TYPE,
    TF: TF_TYPE, TF_STATIC: TF_TYPE,
}  # fmt: skip
"""Of the topics that we write."""
VERSION: Literal[8] = 8
"""Of the bag format: that of ROS 2 Iron, which Jazzy and later read too."""


def write(path: str | PathLike[str], recording: Recording, storage: str = "sqlite3") -> None:
    """Write the folder ``path``: LaserScan, Odometry (``/ins`` or ``/odom``, and the truth), Imu and TF.

    ``storage`` is sqlite3 or mcap. A beam without return is infinite (REP 117); ranges and angles have 32
    bits. Not kept: relations and the laser's noise. Raises `FormatError` without the package rosbags and for
    a folder that exists, ``ValueError`` for beams that are not evenly spaced and for times before 0.
    """
    path = Path(path)
    _check(recording, path)
    rosbag2, types = rosbags(path).rosbag2, typestore()
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
    full_rate = recording.full_rate
    earliest = recording.time.min() if full_rate is None else full_rate.time.min()
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
        odometry = recording.full_rate
        if odometry is None:
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
