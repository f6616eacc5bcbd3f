"""A bag → a recording."""

from __future__ import annotations

from dataclasses import dataclass, field
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from slam.formats import quaternion
from slam.formats.pose_records import PoseRecords
from slam.formats.rosbag import dead_reckoning
from slam.formats.rosbag.dead_reckoning import DeadReckoning
from slam.formats.rosbag.frames import Frames, Mounting
from slam.formats.rosbag.laser_scans import LaserScans
from slam.formats.rosbag.names import (
    ATTITUDE,
    IMU_TYPE,
    ODOMETRY_TYPE,
    OLD_TF_TYPE,
    SCAN,
    SCAN_TYPE,
    TF_TYPE,
    TRUTH,
    frame,
    seconds,
)
from slam.formats.rosbag.storage import messages, topics
from slam.formats.text import File, FormatError, recording_name
from slam.recording import Laser, Odometry, Recording


@dataclass
class _Bag:
    """What the messages of one bag said so far."""

    scans: LaserScans
    frames: Frames
    odometries: dict[str, DeadReckoning]
    truth: PoseRecords = field(default_factory=PoseRecords)
    attitude: PoseRecords = field(default_factory=PoseRecords)

    def records(self) -> list[PoseRecords]:
        """All that is looked up at the scans, but frames."""
        return [self.truth, self.attitude, *(one.records for one in self.odometries.values())]


def read(source: File | str | PathLike[str]) -> Recording:
    """Read a bag of ROS 1 or 2: its folder, or its .db3, .mcap or .bag file.

    ``File.topic`` names the laser, else it is ``/scan`` or the first by name; ``File.odometry`` names the
    dead reckoning, else it is the first of ``/ins``, ``/odom``, the other odometries and odom → base on
    ``/tf`` that moves. ``/ground_truth`` is the truth. Dead reckoning is interpolated at the scans, and kept
    at its full rate where there is more of it. The mount is what fixed transforms say, and zero where they do
    not lead from the laser to the robot; the scans of a laser that hangs upside down are mirrored. Raises
    `FormatError`.
    """
    file = File.of(source)
    path, kinds = file.path, topics(file.path)
    laser_topic, lasers = _laser_topic(kinds, file)
    bag = _collect(path, kinds, laser_topic)
    found = dead_reckoning.candidates(bag.odometries, bag.frames)
    chosen = dead_reckoning.choose(found, bag.frames, file.odometry, path)
    mounting = bag.frames.mount(bag.scans.frame, "" if chosen is None else chosen.base)
    others = [name for name in lasers if name != laser_topic]
    notes = (
        _laser_note(bag.scans, mounting, others),
        dead_reckoning.describe(chosen, found),
        _count(bag.scans),
    )
    try:
        return _recording(path, bag, chosen, mounting, notes)
    except FormatError:
        raise
    except ValueError as error:
        raise FormatError(str(error), path) from None


def _laser_topic(kinds: list[tuple[str, str]], file: File) -> tuple[str, list[str]]:
    """The laser to read, and all there are. Raises `FormatError` where it is not there."""
    lasers = [name for name, kind in kinds if kind == SCAN_TYPE]
    if not lasers:
        listed = ", ".join(name for name, _ in kinds[:9]) or "nothing"
        message = f"no {SCAN_TYPE}, expected at least one: the bag has {listed}"
        raise FormatError(message, file.path)
    if file.topic and file.topic not in lasers:
        message = f"no laser {file.topic!r}, expected one of those in the bag: {', '.join(lasers)}"
        raise FormatError(message, file.path)
    return file.topic or (SCAN if SCAN in lasers else lasers[0]), lasers


def _collect(path: Path, kinds: list[tuple[str, str]], laser: str) -> _Bag:
    bag = _Bag(LaserScans(laser, path), Frames(path), {})
    tf = {name for name, kind in kinds if kind in (TF_TYPE, OLD_TF_TYPE)}
    odometries = {name for name, kind in kinds if kind == ODOMETRY_TYPE and name != TRUTH}
    others = {name for name, kind in kinds if (name, kind) in ((TRUTH, ODOMETRY_TYPE), (ATTITUDE, IMU_TYPE))}
    for topic, message in messages(path, {laser} | tf | odometries | others):
        if topic == laser:
            if bag.scans.take(message):
                bag.frames.scan()
                for records in bag.records():
                    records.scan()
        elif topic in tf:
            bag.frames.take(topic, message)
        elif topic == ATTITUDE:
            q = message.orientation
            bag.attitude.add(seconds(message.header.stamp), list(quaternion.roll_pitch(q.w, q.x, q.y, q.z)))
        elif topic == TRUTH:
            bag.truth.add(*_pose_of(message))
        else:
            _odometry_of(bag, topic, message).records.add(*_pose_of(message))
    if not bag.scans.rows:
        raise FormatError(f"no scan on {laser} has ranges, expected at least one", path)
    return bag


def _odometry_of(bag: _Bag, topic: str, message: Any) -> DeadReckoning:
    if topic not in bag.odometries:
        records = PoseRecords(before_scan=[0] * len(bag.scans.rows))
        bag.odometries[topic] = DeadReckoning(topic, records, frame(message.child_frame_id))
    return bag.odometries[topic]


def _pose_of(message: Any) -> tuple[float, list[float]]:
    """Stamp [s] and pose (x, y, yaw) of an Odometry."""
    position, q = message.pose.pose.position, message.pose.pose.orientation
    yaw = quaternion.yaw_of(q.w, q.x, q.y, q.z)
    return seconds(message.header.stamp), [position.x, position.y, yaw]


def _recording(
    path: Path, bag: _Bag, chosen: DeadReckoning | None, mounting: Mounting | None, notes: tuple[str, ...]
) -> Recording:
    time = np.array(bag.scans.times)
    angles, ranges = bag.scans.grid()
    if mounting is not None and mounting.upside_down:
        angles, ranges = -angles[::-1], ranges[:, ::-1]
    has_attitude = chosen is None or chosen.source == "ins"
    return Recording(
        name=recording_name(path),
        time=time,
        ranges=ranges,
        angles=angles,
        laser=_laser(bag.scans, mounting),
        dead_reckoning=np.zeros((len(time), 3)) if chosen is None else chosen.records.at_scans(time),
        source="none" if chosen is None else chosen.source,
        odometry=None if chosen is None else _full_rate(chosen.records, len(time)),
        attitude=bag.attitude.at_scans(time) if has_attitude and bag.attitude.times else None,
        truth=bag.truth.at_scans(time) if bag.truth.times else None,
        notes=notes,
    )


def _laser(scans: LaserScans, mounting: Mounting | None) -> Laser:
    low, high = scans.limits
    if mounting is None:
        return Laser(low, high)
    return Laser(low, high, T_robot_laser=mounting.pose, mount_source=mounting.source)


def _full_rate(records: PoseRecords, scans: int) -> Odometry | None:
    if len(records.times) <= scans:
        return None
    rows = np.maximum(np.array(records.before_scan) - 1, 0)
    return Odometry(time=np.array(records.times), poses=np.array(records.values), scan_row=rows)


def _laser_note(scans: LaserScans, mounting: Mounting | None, others: list[str]) -> str:
    upside_down = ", upside down: mirrored" if mounting is not None and mounting.upside_down else ""
    more = f" (--topic names another: {', '.join(others)})" if others else ""
    return f"laser {scans}{upside_down}{more}"


def _count(scans: LaserScans) -> str:
    empty = scans.messages - len(scans.rows)
    return f"{len(scans.rows)} scans, " + (f"{empty} without ranges dropped" if empty else "none dropped")
