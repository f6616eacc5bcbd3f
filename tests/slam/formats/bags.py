"""A small recording, and bags as others write them, message by message."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from slam import se2
from slam.formats import FormatError, load, quaternion
from slam.formats.rosbag import writer as rosbag
from slam.recording import Laser, Recording

SCANS, BEAMS = 6, 9


def recording() -> Recording:
    rng = np.random.default_rng(1)
    ranges = np.round(rng.uniform(0.1, 3.99, (SCANS, BEAMS)), 2)
    ranges[:, 3] = np.nan
    ranges[0, :2] = [0.1, 3.99]
    truth = rng.normal(0.0, 5.0, (SCANS, 3))
    truth[:, 2] = se2.wrap(3.0 + 0.2 * np.arange(SCANS))
    return Recording(
        name="bag",
        time=0.3 * np.arange(SCANS),
        ranges=ranges,
        angles=np.linspace(-2.09445, 2.09445, BEAMS),
        laser=Laser(0.1, 4.0, 0.01, np.array([-0.08, 0.03, 0.2])),
        dead_reckoning=truth + rng.normal(0.0, 0.1, truth.shape) * [1, 1, 0.01],
        source="ins",
        attitude=rng.normal(0.0, 0.2, (SCANS, 2)),
        truth=truth,
    )


class Bag:
    """A foreign bag, message by message."""

    def __init__(self, path: Path) -> None:
        from rosbags import rosbag1, rosbag2
        from rosbags.typesys import Stores, get_types_from_msg, get_typestore

        self.ros1 = path.suffix == ".bag"
        self.types = get_typestore(Stores.ROS1_NOETIC if self.ros1 else Stores.ROS2_HUMBLE)
        if self.ros1:
            tf = "geometry_msgs/TransformStamped[] transforms"
            self.types.register(get_types_from_msg(tf, "tf2_msgs/msg/TFMessage"))
        self.messages = rosbag.Messages(get_typestore(Stores.ROS2_HUMBLE).types)
        self.writer: Any = rosbag1.Writer(path) if self.ros1 else rosbag2.Writer(path, version=8)
        self.connections: dict[str, Any] = {}
        self.clock = 0

    def __enter__(self) -> Bag:
        self.writer.open()
        return self

    def __exit__(self, *_: object) -> None:
        self.writer.close()

    def say(self, topic: str, message: Any) -> None:
        kind = message.__msgtype__
        if topic not in self.connections:
            self.connections[topic] = self.writer.add_connection(topic, kind, typestore=self.types)
        self.clock += 1
        if self.ros1:
            for header in (
                [message.header] if hasattr(message, "header") else [t.header for t in message.transforms]
            ):
                header.__dict__["seq"] = 0
        serialise = self.types.serialize_ros1 if self.ros1 else self.types.serialize_cdr
        self.writer.write(self.connections[topic], self.clock, serialise(message, kind))

    def odometry(self, time: float, x: float, topic: str = "/robot/odom") -> None:
        self.say(topic, self.messages.odometry(time, "odom", np.array([x, 0.0, 0.1])))

    def moved(self, time: float, x: float, parent: str = "odom", child: str = "base_link") -> None:
        self.say("/tf", self.messages.tf(time, parent, child, np.array([x, 0.0, 0.1])))

    def scan(self, time: float, topic: str = "/robot/scan", **changes: Any) -> None:
        given = replace(recording(), time=np.full(SCANS, time))
        message = self.messages.scan(given, 0)
        for name, value in changes.items():
            setattr(message, name, value)
        self.say(topic, message)

    def link(
        self,
        parent: str,
        child: str,
        pose: tuple[float, float, float],
        roll: float = 0.0,
        topic: str = "/tf_static",
    ) -> None:
        message = self.messages.tf(0.0, parent, child, np.array(pose))
        if roll:
            w, x, y, z = quaternion.from_angles(roll, 0.0, pose[2])
            message.transforms[0].transform.rotation = self.types.types["geometry_msgs/msg/Quaternion"](
                x, y, z, w
            )
        self.say(topic, message)


def refused(path: Path, message: str) -> None:
    with pytest.raises(FormatError, match=message) as caught:
        load(path)
    assert str(caught.value).startswith(str(path))
    assert "\n" not in str(caught.value)
