"""Answers that were handed in: read, matched to the scans by their stamps, and refused with a reason."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from scenarios.run_folder.directory import safe_name
from slam import se2
from slam.cli import InputError
from slam.formats import FormatError, answer
from slam.formats.text import recording_name
from slam.recording import Laser, Recording
from slam.se2 import Array
from slam.trajectory import Body, Trajectory
from stitch.mapping.estimate import Estimate, NoEstimate

TOLERANCE = 0.02
"""A pose is a scan's if their stamps are no further apart [s]: files round to the millisecond, and the
quickest lasers here take 25 ms for a scan."""
LEAST_COVERAGE = 0.9
"""Share of the scans that an answer must have a pose for; the rest is interpolated."""
MAP_SUFFIXES = (".yaml", ".yml")
LONGEST_NAME = 60


@dataclass(frozen=True)
class Answer:
    """What was handed in under a ``name``: a ``trajectory``, or the map in the file ``path``."""

    name: str
    path: Path
    trajectory: Trajectory | None


def read_answers(paths: Sequence[Path], taken: Sequence[str] = ()) -> list[Answer]:
    """The answers in files, named after them and apart from the names ``taken``. Raises `InputError` for a
    file that cannot be read."""
    answers: list[Answer] = []
    for path in paths:
        is_map = path.suffix.lower() in MAP_SUFFIXES
        wanted = f"{_name(path)} (map)" if is_map else _name(path)
        name = _vacant(wanted, [*taken, *(one.name for one in answers)])
        try:
            if is_map:
                answer.check_size(path)
                if not path.is_file():
                    raise FormatError("no such file", path)
                answers.append(Answer(name, path, None))
            else:
                answers.append(Answer(name, path, answer.read(path)))
        except (FormatError, ValueError) as error:
            raise InputError(str(error)) from error
    return answers


def _name(path: Path) -> str:
    """``slam toolbox`` for ``answers/slam toolbox.tum``: printable, and of no more than a line."""
    stem = path.stem if path.suffix in (".tum", ".yaml", ".yml", ".npz") else recording_name(path)
    return re.sub(r"[^\w .()+,=<>&'\"-]+", "_", stem).strip()[:LONGEST_NAME] or "answer"


def _vacant(name: str, taken: Sequence[str]) -> str:
    """The name, or with a number behind it the first whose files would not be another's."""
    files = {safe_name(one) for one in taken}
    candidates = (name, *(f"{name} {k}" for k in range(2, len(files) + 3)))
    return next(one for one in candidates if safe_name(one) not in files)


def to_estimate(
    name: str, found: Trajectory, recording: Recording, tolerance: float, body: Body
) -> tuple[Estimate | NoEstimate, float]:
    """A trajectory as a method's answer, the robot's pose at every scan, and its coverage.

    A scan has the pose whose stamp is nearest, no further than ``tolerance`` s; scans without one lie between
    those that have one. ``body`` is taken where the file does not say whose poses they are. Below
    `LEAST_COVERAGE` it has no answer. Raises `InputError` where no stamp matches.
    """
    rows = match(found.time, recording.time, tolerance)
    known = rows >= 0
    coverage = float(known.mean())
    if not np.any(known):
        raise InputError(f"{name}: {_strangers(found.time, recording.time, tolerance)}")
    if coverage < LEAST_COVERAGE:
        share = f"{math.floor(1000.0 * coverage) / 10.0:g} %"
        reason = f"poses for {share} of the scans, expected at least {100.0 * LEAST_COVERAGE:g} %"
        return NoEstimate(name, reason), coverage
    found = as_robot(found, recording.laser, body)
    covariance = None
    if found.covariance is not None:
        covariance = np.full((len(rows), 3, 3), np.nan)
        covariance[known] = found.covariance[rows[known]]
    return Estimate(name, interpolated(found.poses[rows], known), covariance), coverage


def match(time: Array, scans: Array, tolerance: float) -> np.ndarray:
    """For each of the stamps ``scans (N,)`` the row of the nearest of ``time (M,)``, -1 where none is within
    ``tolerance`` s. As many stamps that agree one by one are taken in their order, for stamps may go
    backwards and repeat."""
    if len(time) == len(scans) and np.all(np.abs(time - scans) <= tolerance):
        return np.arange(len(scans))
    order = np.argsort(time, kind="stable")
    at = time[order]
    after = np.clip(np.searchsorted(at, scans), 0, len(at) - 1)
    before = np.maximum(after - 1, 0)
    nearest = np.where(np.abs(scans - at[before]) <= np.abs(at[after] - scans), before, after)
    rows: np.ndarray = order[nearest]
    rows[np.abs(time[rows] - scans) > tolerance] = -1
    return rows


def interpolated(poses: Array, known: np.ndarray) -> Array:
    """``poses (N, 3)`` where they are ``known (N,)``, between them along the straight line, beyond them as
    the first and last."""
    rows, places = np.arange(len(poses)), np.flatnonzero(known)
    yaw = np.unwrap(poses[places, 2])
    columns = [poses[places, 0], poses[places, 1], yaw]
    filled = np.stack([np.interp(rows, places, column) for column in columns], -1)
    filled[:, 2] = se2.wrap(filled[:, 2])
    filled[known] = poses[known]
    return filled


def as_robot(found: Trajectory, laser: Laser, body: Body) -> Trajectory:
    """The trajectory of the robot, where it is that of its laser."""
    if (found.body or body) != "laser":
        return found
    mount = laser.T_robot_laser
    sigma = None if found.covariance is None else se2.transport(found.covariance, mount)
    poses = se2.compose(found.poses, se2.inverse(mount))
    return replace(found, poses=poses, covariance=sigma, body="robot")


def _strangers(time: Array, scans: Array, tolerance: float) -> str:
    """What to say of stamps that match no scan."""
    theirs, ours = (f"{a.min():.3f} to {a.max():.3f} s" for a in (time, scans))
    return (
        f"none of its {len(time)} stamps, {theirs}, is within {tolerance:g} s of a scan, expected stamps of "
        f"the recording, {ours}"
    )
