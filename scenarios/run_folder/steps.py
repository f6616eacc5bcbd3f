"""steps.csv: what happened to every scan."""

from __future__ import annotations

import csv
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from slam import se2
from slam.odometry.track import Track, Verdict
from slam.recording import Recording
from slam.se2 import Array
from stitch.mapping.estimate import Estimate

COLUMNS = ("method", "scan", "time", "verdict", "reference", "matches", "error_trans", "error_rot")


def write_steps(path: Path, recording: Recording, estimates: Sequence[Estimate]) -> None:
    """One row per scan and method with a track: verdict, true error of the step [m, rad], confidence.

    The step is the one from the scan in the column ``reference``. What does not exist is an empty cell.
    """
    tracks = {estimate.method: estimate.track for estimate in estimates if estimate.track is not None}
    measures = list(dict.fromkeys(name for track in tracks.values() for name in track.confidence))
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow([*COLUMNS, *measures])
        for method, track in tracks.items():
            writer.writerows(_rows(method, track, recording, measures))


def _rows(
    method: str, track: Track, recording: Recording, measures: Sequence[str]
) -> Iterator[tuple[object, ...]]:
    absent = np.full(len(track), np.nan)
    numbers = [*_errors(track, recording), *(track.confidence.get(name, absent) for name in measures)]
    return zip(
        [method] * len(track),
        range(len(track)),
        map(repr, recording.time.tolist()),
        (Verdict(verdict).name for verdict in track.verdict),
        track.reference.tolist(),
        track.matches.tolist(),
        *([_cell(value) for value in column.tolist()] for column in numbers),
        strict=True,
    )


def _errors(track: Track, recording: Recording) -> tuple[Array, Array]:
    """Translation [m] and rotation [rad] error ``(N,)`` of each step, NaN without truth or reference."""
    if recording.truth is None:
        return np.full(len(track), np.nan), np.full(len(track), np.nan)
    step = se2.between(track.poses[track.reference], track.poses)
    off = se2.between(se2.between(recording.truth[track.reference], recording.truth), step)
    off[track.reference < 0] = np.nan
    return np.hypot(off[:, 0], off[:, 1]), np.abs(off[:, 2])


def _cell(value: float) -> str:
    return "" if value != value else f"{value:.9g}"
