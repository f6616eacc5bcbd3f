"""One file per format; `load` recognises which one a recording is in."""

from __future__ import annotations

import re
from os import PathLike
from pathlib import Path

import numpy as np

from slam.formats import carmen, recording_npz, rosbag, usarsim
from slam.formats import relations as relations_file
from slam.formats.errors import FormatError
from slam.formats.text import decode, read_bytes
from slam.recording import Recording

__all__ = ["FormatError", "load"]

ZIP_MAGIC = b"PK\x03\x04"
USARSIM = re.compile(r"^(# UvA Rescue Team|(SEN|STA|MISSTA|GEO|CONF|NFO|INIT) \{)", re.MULTILINE)
CHANGED, LEAST_BEAMS = 0.2, 20
"""A beam that changed by more [m] sees something else; so many beams must be compared."""
CARMEN = re.compile(r"^(FLASER|ODOM|ROBOTLASER1|RAWLASER1|PARAM|SYNC)\b", re.MULTILINE)


def load(path: str | PathLike[str], relations: str | PathLike[str] | None = None) -> Recording:
    """Read a recording: USARSim log, CARMEN log (both also gzipped), recording.npz or ROS 2 bag.

    Files are recognised by content, a bag by its folder's metadata.yaml or by its suffix, .db3 or .mcap.

    ``relations`` names a file of true relative poses to score the recording against. A log whose dead
    reckoning never changes while its scans do has none. Raises `FormatError`, one line naming file and line,
    for anything that cannot be read.
    """
    path = Path(path)
    recording = _load(path)
    if recording.source != "none" and dead_reckoning_is_stuck(recording):
        recording = recording.without_dead_reckoning()
    return recording if relations is None else recording.with_relations(relations_file.read(relations))


def dead_reckoning_is_stuck(recording: Recording) -> bool:
    """True where all poses are one though the laser saw the robot move.

    It did where in a fifth of the scans half of the beams that returned, and did in the first scan, changed
    by `CHANGED` m: what moves past a robot at rest changes fewer.
    """
    poses = recording.dead_reckoning if recording.odometry is None else recording.odometry.poses
    if np.any(poses != poses[0]):
        return False
    both = np.isfinite(recording.ranges) & np.isfinite(recording.ranges[0])
    changed = both & (np.abs(recording.ranges - recording.ranges[0]) > CHANGED)
    return bool(np.mean(2 * changed.sum(axis=1) > np.maximum(both.sum(axis=1), LEAST_BEAMS)) > 0.2)


def _load(path: Path) -> Recording:
    if rosbag.is_bag(path):
        return rosbag.read(path)
    data = read_bytes(path)
    if data.startswith(ZIP_MAGIC):
        return recording_npz.parse(data, path)
    text = decode(data, path)
    if USARSIM.search(text):
        return usarsim.parse(text, path)
    if CARMEN.search(text):
        return carmen.parse(text, path)
    raise FormatError("not a recording: expected a USARSim log, a CARMEN log or a recording.npz", path)
