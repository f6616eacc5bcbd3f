"""One file per format; `load` recognises which one a recording is in."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from os import PathLike

import numpy as np

from slam.formats import carmen, foreign, recording_npz, usarsim
from slam.formats import relations as relations_file
from slam.formats.rosbag import reader as rosbag_reader
from slam.formats.rosbag import storage as rosbag_storage
from slam.formats.rosbag import writer as rosbag_writer
from slam.formats.text import File, FormatError
from slam.recording import Recording

__all__ = ["FORMATS", "Format", "FormatError", "load"]

CHANGED, LEAST_BEAMS = 0.2, 20
"""A beam that changed by more [m] sees something else; so many beams must be compared."""


@dataclass(frozen=True)
class Format:
    """How recordings are kept in files.

    ``title`` for messages; ``recognise`` tells a file of this format, by path or content, from all others;
    ``read`` raises `FormatError`; ``write`` takes a path and a recording, and is None for a format that is
    only read. ``has_angles``: whether such a file always states where its beams point.
    """

    title: str
    recognise: Callable[[File], bool]
    read: Callable[[File], Recording]
    write: Callable[[str | PathLike[str], Recording], None] | None = None
    has_angles: bool = True


FORMATS = {
    "rosbag": Format("a ROS bag", rosbag_storage.recognise, rosbag_reader.read, rosbag_writer.write),
    "npz": Format("a recording.npz", recording_npz.recognise, recording_npz.read, recording_npz.write),
    "usarsim": Format("a USARSim log", usarsim.recognise, usarsim.read, usarsim.write, False),
    "carmen": Format("a CARMEN log", carmen.recognise, carmen.read, carmen.write, False),
}
"""Formats of recordings, in the order in which a file is tried. A further one is a file of its own and an
entry here; `tests/slam/formats/test_load.py` tries it on arrival."""


def load(
    path: str | PathLike[str],
    relations: str | PathLike[str] | None = None,
    field_of_view: float | None = None,
    topic: str = "",
    odometry: str = "",
) -> Recording:
    """Read a recording in any of the `FORMATS`; logs may be compressed (`packed.PACKINGS`).

    Files are recognised by content, a bag by its folder's files or by its suffix, .db3, .mcap or .bag. In a
    bag ``topic`` names the laser and ``odometry`` the dead reckoning.

    ``relations`` names a file of true relative poses to score the recording against; ``field_of_view`` is
    what the user says that a text log's laser spans, in degrees. A log whose dead reckoning never changes
    while its scans do has none. Raises `FormatError`, one line naming file and line, for anything that cannot
    be read.
    """
    file = File(path, field_of_view=field_of_view, topic=topic, odometry=odometry)
    form = _format_of(file)
    if field_of_view is not None and form.has_angles:
        raise FormatError(f"{form.title} states its field of view, expected none beside it", path)
    if (topic or odometry) and form is not FORMATS["rosbag"]:
        raise FormatError(f"{form.title} has no topics, expected a ROS bag", path)
    recording = form.read(file)
    if not np.isfinite(recording.ranges).any():
        low, high = recording.laser.range_min, recording.laser.range_max
        message = f"no beam of {len(recording)} scans returned, expected ranges from {low:g} to {high:g} m"
        raise FormatError(message, path)
    if recording.source != "none" and dead_reckoning_is_stuck(recording):
        recording = recording.without_dead_reckoning()
    return recording if relations is None else recording.with_relations(relations_file.read(relations))


def _format_of(file: File) -> Format:
    for form in FORMATS.values():
        if form.recognise(file):
            return form
    *titles, last = (form.title for form in FORMATS.values())
    kind = foreign.describe(file.data) or f"not a recording: expected {', '.join(titles)} or {last}"
    raise FormatError(kind, file.path)


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
