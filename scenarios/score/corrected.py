"""A CARMEN log with the poses that a system found in every line of it, for Freiburg's metricEvaluator."""

from __future__ import annotations

import tempfile
from pathlib import Path

from scenarios.evaluation.relations import carry
from scenarios.score.answers import TOLERANCE, read_answers, to_estimate
from scenarios.source import Source, with_estimated_mount
from slam.cli import InputError
from slam.formats import FormatError, carmen
from slam.formats.text import File
from slam.odometry.laser_mount import is_mount_unstated
from slam.recording import Recording
from slam.trajectory import Body
from stitch.mapping.config import MappingConfig
from stitch.mapping.estimate import NoEstimate


def write_corrected(out: Path, answer: Path, recording: Recording, log: Path) -> Path:
    """Write the CARMEN ``log`` that a recording is from, or the one it would be exported as, to ``out`` with
    the trajectory in the file ``answer``.

    The lines between two scans get what dead reckoning makes of the answer at both, as relations are scored.
    Raises `InputError`, and ``ValueError`` for a recording that no CARMEN log can hold.
    """
    body: Body = "robot"
    if is_mount_unstated(recording):
        recording = with_estimated_mount(Source(recording, {}), MappingConfig())[0].recording
        body = "laser" if recording.laser.mount_source == "the drive" else "robot"
    (handed,) = read_answers([answer])
    if handed.trajectory is None:
        raise InputError(f"--poses {answer}: expected a trajectory, got a map")
    found, _ = to_estimate(handed.name, handed.trajectory, recording, TOLERANCE, body)
    if isinstance(found, NoEstimate):
        raise InputError(f"--poses {answer}: {found.reason}")
    try:
        with tempfile.TemporaryDirectory() as folder:
            original = _as_carmen(recording, log, Path(folder))
            odometry = carmen.odometry_of(original)
            poses = carry(found.poses, odometry)
            carmen.write_corrected(out, original, poses, recording.laser.T_robot_laser)
    except FormatError as error:
        raise InputError(str(error)) from error
    return out


def _as_carmen(recording: Recording, log: Path, folder: Path) -> File:
    """The log where it is a CARMEN log, else the recording written as one."""
    if log.is_file():
        file = File(log)
        try:
            if carmen.recognise(file):
                return file
        except FormatError:  # no text
            pass
    carmen.write(folder / "recording.log", recording)
    file = File(folder / "recording.log")
    return File(file.path, data=file.data)
