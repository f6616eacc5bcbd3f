"""tracks.npz and submaps.npz: the arrays of every method's track and submaps, written and read back.

``numpy.load(path, allow_pickle=False)`` reads both.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np

from slam.mapping.occupancy import Grid
from slam.mapping.submap import Submap
from slam.odometry.track import Track
from slam.scan import Scan
from stitch.mapping.estimate import Estimate

TRACKS_FILE, SUBMAPS_FILE = "tracks.npz", "submaps.npz"
COVARIANCE = "pose_covariance"
TRACK_FIELDS = tuple(field.name for field in fields(Track) if field.name != "confidence")

Arrays = Mapping[str, np.ndarray]


def write_tracks(path: Path, estimates: Sequence[Estimate]) -> None:
    """The fields of every track as ``method/field``, its measures as ``method/confidence/name``; the marginal
    covariances of the poses as ``method/pose_covariance``."""
    arrays: dict[str, np.ndarray] = {}
    for estimate in estimates:
        if estimate.covariance is not None:
            arrays[f"{estimate.method}/{COVARIANCE}"] = estimate.covariance
        if estimate.track is not None:
            for name in TRACK_FIELDS:
                arrays[f"{estimate.method}/{name}"] = getattr(estimate.track, name)
            for name, column in estimate.track.confidence.items():
                arrays[f"{estimate.method}/confidence/{name}"] = column
    _save(path, arrays)


def read_track(arrays: Arrays, method: str) -> Track | None:
    """The track of a method, None where it has none."""
    if f"{method}/poses" not in arrays:
        return None
    start = f"{method}/confidence/"
    confidence = {name.removeprefix(start): arrays[name] for name in arrays if name.startswith(start)}
    values: dict[str, Any] = {name: arrays[f"{method}/{name}"] for name in TRACK_FIELDS}
    return Track(**values, confidence=confidence)


def write_submaps(path: Path, estimates: Sequence[Estimate]) -> None:
    """Every submap as the method used it: ``method/k/field`` is a field of its k-th submap, or of the
    submap's points or grid."""
    arrays: dict[str, np.ndarray] = {}
    for estimate in estimates:
        for k, submap in enumerate(estimate.submaps):
            values = vars(submap) | vars(submap.points) | vars(submap.grid)
            del values["grid"]  # "points" of the submap are by now those of its scan
            arrays |= {f"{estimate.method}/{k}/{name}": np.asarray(value) for name, value in values.items()}
    _save(path, arrays)


def read_submaps(arrays: Arrays, method: str) -> tuple[Submap, ...]:
    """The submaps of a method as they were in memory; empty where it has none."""
    submaps: list[Submap] = []
    while (at := f"{method}/{len(submaps)}/") + "start" in arrays:
        points = Scan(**{field.name: arrays[at + field.name] for field in fields(Scan)})
        grid = Grid(
            arrays[at + "occupied"],
            arrays[at + "free"],
            arrays[at + "origin"],
            float(arrays[at + "resolution"]),
        )
        start, stop = int(arrays[at + "start"]), int(arrays[at + "stop"])
        submaps.append(Submap(start, stop, arrays[at + "anchor"], points, grid))
    return tuple(submaps)


def _save(path: Path, arrays: Arrays) -> None:
    with path.open("wb") as file:
        np.savez_compressed(file, **arrays)  # type: ignore[arg-type]
