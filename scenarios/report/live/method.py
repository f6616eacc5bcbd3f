"""A method's answer as the page draws it: path, map, pieces, what it said of every scan."""

from __future__ import annotations

import numpy as np

from scenarios.evaluation.maps import map_at
from scenarios.report.cuts import cuts
from scenarios.report.live.fit import fitting
from scenarios.report.live.packed import bits, packed
from scenarios.report.live.shown import Shown
from scenarios.report.live.surroundings import map_image
from scenarios.report.spread import covariance_of, in_axes
from slam import se2
from slam.odometry.track import Track
from slam.recording import Recording
from slam.se2 import Array
from stitch.mapping.estimate import Estimate

POINT_UNIT = 0.01
"""What the points of submaps are rounded to [m]."""


def method(shown: Shown, estimate: Estimate) -> dict[str, object]:
    """Everything about a method but its stitches."""
    recording, rows = shown.recording, shown.rows
    poses = shown.placed(estimate.poses)
    return {
        "name": estimate.method,
        "poses": packed(poses[rows]),
        "map": _map(recording, poses),
        "fits": bits(fitting(recording, estimate.poses, rows)),
        "track": None if estimate.track is None else _track(estimate.track, recording, rows),
        "spread": _spread(estimate, poses, rows),
        "submaps": _submaps(estimate, poses),
        "cuts": [[int(first), int(last)] for first, last in cuts(estimate.submaps)],
    }


def _map(recording: Recording, poses: Array) -> dict[str, object] | None:
    """The map, None where the method lost itself so far that no image holds it."""
    try:
        return map_image(map_at(recording, poses))
    except ValueError:
        return None


def _track(track: Track, recording: Recording, rows: np.ndarray) -> dict[str, object]:
    """Verdict, matches and confidence of every scan, and the true error of its step."""
    columns = {name: packed(column[rows]) for name, column in track.confidence.items()}
    told: dict[str, object] = {
        "verdict": packed(track.verdict[rows], "u1"),
        "matches": packed(track.matches[rows], "u2"),
        "measures": columns,
        "error": None,
    }
    if recording.truth is not None:
        step = se2.between(track.poses[track.reference], track.poses)
        off = se2.between(se2.between(recording.truth[track.reference], recording.truth), step)
        error = np.where(track.reference < 0, np.nan, np.hypot(off[:, 0], off[:, 1]))
        told["error"] = packed(error[rows])
    return told


def _spread(estimate: Estimate, poses: Array, rows: np.ndarray) -> dict[str, object] | None:
    """Covariance xx, xy, yy [m²] of every position in the page's axes, and of what it is."""
    found = covariance_of(estimate)
    if found is None:
        return None
    P = in_axes(poses[rows], found[0][rows])
    what = {"pose": "of the pose", "step": "of the step from the scan it was matched to"}[found[1]]
    return {"what": what, "values": packed(np.stack([P[:, 0, 0], P[:, 0, 1], P[:, 1, 1]], -1))}


def _submaps(estimate: Estimate, poses: Array) -> list[dict[str, object]]:
    """Each submap's scans, place, and wall points in its own frame."""
    return [
        {
            "start": submap.start,
            "stop": submap.stop,
            "pose": [round(float(value), 5) for value in poses[submap.start]],
            "points": packed(submap.grid.occupied_points(), "i2", POINT_UNIT),
        }
        for submap in estimate.submaps
    ]
