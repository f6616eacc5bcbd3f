"""The tree of frames that a bag's transforms span: where the laser sits on the robot, and what moved."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from slam.formats import quaternion
from slam.formats.pose_records import PoseRecords
from slam.formats.rosbag.names import frame, seconds
from slam.formats.text import FormatError
from slam.se2 import Array

STILL = 1e-6
"""A frame that moved less in its parent [m, and in the quaternion's components] is fixed to it."""
LEVEL = np.deg2rad(5.0)
"""A laser mounted with more tilt than this [rad] does not see the plane."""


@dataclass
class Link:
    """A frame in its parent: ``first`` is (x, y, z, qw, qx, qy, qz), ``poses`` are in the plane."""

    parent: str
    topic: str
    first: tuple[float, ...]
    poses: PoseRecords
    moves: bool = False


@dataclass
class Frames:
    """All links said so far, by child, of the bag at ``path``."""

    path: Path
    links: dict[str, Link] = field(default_factory=dict)
    scans: int = 0

    def take(self, topic: str, message: Any) -> None:
        """The transforms of one TFMessage."""
        for transform in message.transforms:
            child, parent = frame(transform.child_frame_id), frame(transform.header.frame_id)
            p, q = transform.transform.translation, transform.transform.rotation
            values = (p.x, p.y, p.z, q.w, q.x, q.y, q.z)
            link = self.links.get(child)
            if link is None or link.parent != parent:
                poses = PoseRecords(before_scan=[0] * self.scans)
                link = self.links[child] = Link(parent, topic, values, poses)
            apart = max(abs(a - b) for a, b in zip(values, link.first, strict=True))
            link.moves = link.moves or not apart <= STILL
            link.poses.add(seconds(transform.header.stamp), [p.x, p.y, quaternion.yaw_of(q.w, q.x, q.y, q.z)])

    def scan(self) -> None:
        """A scan comes here."""
        self.scans += 1
        for link in self.links.values():
            link.poses.scan()

    def mount(self, laser: str, base: str) -> Mounting | None:
        """How the laser sits on frame ``base`` (none: on the last frame it is fixed to); None where no chain
        of fixed links says so. Raises `FormatError` for a laser that does not look along the plane."""
        T, at, sources = np.eye(4), laser, set()
        for _ in range(len(self.links)):
            link = self.links.get(at)
            if link is None or link.moves or at == base:
                break
            T = self._matrix(at, link) @ T
            at = link.parent
            sources.add(link.topic)
        if not sources or (base and at != base):
            return None
        if abs(T[2, 2]) < np.cos(LEVEL):
            tilt = np.degrees(np.arccos(np.clip(abs(T[2, 2]), 0.0, 1.0)))
            message = f"the laser {laser!r} is tilted by {tilt:.0f}° on {at!r}, expected a level one"
            raise FormatError(f"{message}: --topic names another", self.path)
        pose = np.array([T[0, 3], T[1, 3], np.arctan2(T[1, 0], T[0, 0])])
        return Mounting(pose, bool(T[2, 2] < 0.0), " and ".join(sorted(sources)))

    def _matrix(self, child: str, link: Link) -> Array:
        position, q = link.first[:3], link.first[3:]
        if not any(q) or not np.all(np.isfinite(link.first)):
            message = f"{link.topic} turns {child!r} by the quaternion {q}, expected a rotation"
            raise FormatError(message, self.path)
        T = np.eye(4)
        T[:3, :3] = quaternion.matrix(*q)
        T[:3, 3] = position
        return T


@dataclass(frozen=True)
class Mounting:
    """The laser's ``pose (3,)`` on the robot; whether it hangs upside down; and the topics that say so."""

    pose: Array
    upside_down: bool
    source: str
