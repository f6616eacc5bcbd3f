"""Which of a bag's odometries says how the robot moved: the one that moves."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from slam.formats.pose_records import PoseRecords
from slam.formats.rosbag.frames import Frames
from slam.formats.rosbag.names import INS, ODOMETRY, TF
from slam.formats.text import FormatError
from slam.recording import Source
from slam.se2 import wrap

MOVES = 0.1
"""An odometry that came less than this share as far as another is dead."""


@dataclass(frozen=True)
class DeadReckoning:
    """Poses of the robot's frame ``base``; ``name`` is its topic, or ``/tf:base``."""

    name: str
    records: PoseRecords
    base: str

    @property
    def source(self) -> Source:
        """In which frame its increments hold."""
        return "ins" if self.name == INS else "odometry"

    @property
    def extent(self) -> float:
        """How far [m, and rad] it came from where it began."""
        poses = np.array(self.records.values)
        if len(poses) == 0 or not np.all(np.isfinite(poses)):
            return np.inf if len(poses) else 0.0
        apart = poses - poses[0]
        return float(np.max(np.hypot(apart[:, 0], apart[:, 1]) + np.abs(wrap(apart[:, 2]))))


def candidates(odometries: dict[str, DeadReckoning], frames: Frames) -> list[DeadReckoning]:
    """All that a bag says of the robot's motion, the first choice first: ours, topics by name, then moving
    frames, those whose parent is an odometry's (REP 105) before all others."""
    first = [odometries[name] for name in (INS, ODOMETRY) if name in odometries]
    others = [odometries[name] for name in sorted(odometries) if name not in (INS, ODOMETRY)]
    moving = [(child, link) for child, link in sorted(frames.links.items()) if link.moves]
    moving.sort(key=lambda item: "odom" not in item[1].parent)
    return [*first, *others, *(DeadReckoning(f"{TF}:{child}", link.poses, child) for child, link in moving)]


def choose(found: list[DeadReckoning], frames: Frames, name: str, path: Path) -> DeadReckoning | None:
    """The candidate of that name; without one, the first that moves, or the first; None where there is none.

    Of moving frames only those in an odometry's frame are taken unasked: the others are wheels, or another
    SLAM's answer. Raises `FormatError` for a name that is none of them.
    """
    if name:
        named = [one for one in found if name in (one.name, one.name.partition(":")[0])]
        if not named:
            known = ", ".join(one.name for one in found) or "none"
            raise FormatError(f"no odometry {name!r}, expected one of those in the bag: {known}", path)
        return named[0]
    usable = [one for one in found if ":" not in one.name or "odom" in frames.links[one.base].parent]
    farthest = max((one.extent for one in usable), default=0.0)
    return next((one for one in usable if one.extent >= MOVES * farthest), None)


def describe(chosen: DeadReckoning | None, found: list[DeadReckoning]) -> str:
    """What was taken, and what else there is."""
    if chosen is None:
        return "no odometry"
    others = [one.name for one in found if one is not chosen]
    text = f"odometry {chosen.name}, {len(chosen.records.times)} poses"
    return f"{text} (--odometry names another: {', '.join(others)})" if others else text
