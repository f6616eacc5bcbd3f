"""Truth that lies apart from its recording: in a file of its own, as the suite keeps it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from scenarios.score.answers import as_robot, match
from slam.cli import InputError
from slam.formats import FormatError, answer
from slam.recording import Recording


def entry_file(target: str) -> str:
    """The npz in the folder of a suite's recording, ``suite/hospital-0``; any other target as it is."""
    path = Path(target)
    inside = path / f"{path.resolve().name}.npz"
    return str(inside) if inside.is_file() else target


def truth_beside(target: str) -> Path | None:
    """Where the suite keeps the truth of its recording in the file ``target``, ``suite-truth/NAME.tum``; None
    where there is none."""
    path = Path(target).absolute()
    suite = path.parent.parent
    truth = suite.with_name(f"{suite.name}-truth") / f"{path.parent.name}.tum" if suite.name else path
    return truth if truth.suffix == ".tum" and truth.is_file() else None


def with_truth(recording: Recording, path: Path, tolerance: float) -> Recording:
    """The recording with the true poses in a file, matched as an answer is. Raises `InputError` unless every
    scan has one."""
    try:
        found = as_robot(answer.read(path), recording.laser, "robot")
    except (FormatError, ValueError) as error:
        raise InputError(str(error)) from error
    rows = match(found.time, recording.time, tolerance)
    if np.any(rows < 0):
        missing = int(np.sum(rows < 0))
        raise InputError(f"{path}: no pose within {tolerance:g} s for {missing} of {len(rows)} scans")
    return replace(recording, truth=found.poses[rows])
