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
from slam.mapping.submap import Submap, merge_scans
from slam.odometry.track import Track
from slam.recording import Recording
from slam.scan import Scan, scans_of
from slam.se2 import Array
from stitch.mapping.estimate import Estimate

TRACKS_FILE, SUBMAPS_FILE = "tracks.npz", "submaps.npz"
COVARIANCE = "pose_covariance"
SUBMAP_FIELDS = ("start", "stop", "anchor", "rows", "T_anchor_scan")
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


def write_submaps(path: Path, estimates: Sequence[Estimate], recording: Recording) -> None:
    """Every submap as the method used it: ``method/k/field`` is a field of its k-th submap or of its grid.

    Of its points the beams are stored where these, from the recording's scans, give the same points to the
    last bit; else the points themselves.
    """
    scans = scans_of(recording) if any(estimate.submaps for estimate in estimates) else []
    arrays: dict[str, np.ndarray] = {}
    for estimate in estimates:
        for k, submap in enumerate(estimate.submaps):
            values = {name: getattr(submap, name) for name in SUBMAP_FIELDS} | vars(submap.grid)
            counts, beams = _counts(scans, submap), submap.points.beams
            if (
                len(counts)
                and counts.sum() == len(beams)
                and _equal(_points(scans, submap.rows, submap.T_anchor_scan, beams, counts), submap.points)
            ):
                values |= {
                    "beams": beams.astype(np.uint16 if beams.max(initial=0) < 2**16 else np.int64),
                    "counts": counts,
                }
            else:
                values |= vars(submap.points)
            arrays |= {f"{estimate.method}/{k}/{name}": np.asarray(value) for name, value in values.items()}
    _save(path, arrays)


def read_submaps(arrays: Arrays, method: str, scans: Sequence[Scan]) -> tuple[Submap, ...]:
    """The submaps of a method as they were in memory, made of the recording's ``scans``; empty where it has
    none."""
    submaps: list[Submap] = []
    while (at := f"{method}/{len(submaps)}/") + "start" in arrays:
        start, stop = int(arrays[at + "start"]), int(arrays[at + "stop"])
        rows, T_anchor_scan = arrays[at + "rows"], arrays[at + "T_anchor_scan"]
        if at + "points" in arrays:
            points = Scan(**{field.name: arrays[at + field.name] for field in fields(Scan)})
        else:
            points = _points(scans, rows, T_anchor_scan, arrays[at + "beams"], arrays[at + "counts"])
        cells = (arrays[at + "occupied"], arrays[at + "free"], arrays[at + "origin"])
        grid = Grid(*cells, float(arrays[at + "resolution"]))
        submaps.append(Submap(start, stop, arrays[at + "anchor"], points, grid, rows, T_anchor_scan))
    return tuple(submaps)


def _points(
    scans: Sequence[Scan], rows: np.ndarray, T_anchor_scan: Array, beams: np.ndarray, counts: np.ndarray
) -> Scan:
    """The points of ``beams (n,)`` in the anchor's frame, so many of each of the scans ``rows (K,)`` as
    ``counts (K,)`` says."""
    runs = np.split(beams, np.cumsum(counts)[:-1])
    kept = [scans[row].selected(np.isin(scans[row].beams, run)) for row, run in zip(rows, runs, strict=True)]
    return merge_scans(kept, T_anchor_scan)


def _counts(scans: Sequence[Scan], submap: Submap) -> np.ndarray:
    """How many points ``(K,)`` of each of its scans a submap has, as far as they are found in it."""
    points, beams, first, counts = submap.points.points, submap.points.beams, 0, []
    for row, T in zip(submap.rows, submap.T_anchor_scan, strict=True):
        scan, last = scans[row], min(first + len(scans[row]), len(beams))
        place = np.searchsorted(scan.beams, beams[first:last]).clip(max=len(scan) - 1)
        same = np.all(scan.transformed(T).points[place] == points[first:last], axis=1)
        same[1:] &= np.diff(beams[first:last]) > 0
        counts.append(len(same) if same.all() else int(np.argmin(same)))
        first += counts[-1]
    return np.array(counts, dtype=np.int64)


def _equal(a: Scan, b: Scan) -> bool:
    pairs = [(getattr(a, f.name), getattr(b, f.name)) for f in fields(Scan)]
    return all(x.dtype == y.dtype and np.array_equal(x, y, equal_nan=x.dtype.kind == "f") for x, y in pairs)


def _save(path: Path, arrays: Arrays) -> None:
    with path.open("wb") as file:
        np.savez_compressed(file, **arrays)  # type: ignore[arg-type]
