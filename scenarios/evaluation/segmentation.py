"""Lost steps of a track by truth, and how sound the pieces are that a drive was cut into."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from slam import se2
from slam.odometry.confidence import step_error
from slam.odometry.segmentation import Segment
from slam.odometry.track import Track
from slam.recording import Recording
from slam.se2 import Array


def step_deviations(track: Track, truth: Array | None) -> Array:
    """How far each step of a track, from its reference scan, is from the true step: ``(N, 3)`` m, m, rad in
    the body frame, NaN where there is no reference or no ``truth (N, 3)``."""
    if truth is None:
        return np.full(track.poses.shape, np.nan)
    step = se2.between(track.poses[track.reference], track.poses)
    deviations = se2.between(se2.between(truth[track.reference], truth), step)
    deviations[track.reference < 0] = np.nan
    return deviations


def true_errors(track: Track, recording: Recording) -> Array:
    """Error ``(N,)`` of each step in units of `slam.odometry.confidence.FAILURE`: above 1 it is lost; NaN
    where there is no step. Raises ``ValueError`` where the recording has no truth."""
    if recording.truth is None:
        raise ValueError(f"{recording.name}: expected a recording with truth")
    return step_error(step_deviations(track, recording.truth))


@dataclass(frozen=True)
class Purity:
    """Of the pieces of a drive: how many; the share of the scans that is in one; of those the share in a
    piece that is nowhere off by more than a failure; and the mean over them of the largest error [m] inside
    their piece, seen from its first pose."""

    count: int
    kept: float
    pure: float
    drift: float


def purity(pieces: Sequence[Segment], poses: Array, truth: Array) -> Purity:
    """Soundness of ``pieces`` of a track with ``poses (N, 3)``; NaN where there is no piece."""
    if not pieces:
        return Purity(0, 0.0, float("nan"), float("nan"))
    worst = [_worst(poses[p.start : p.stop], truth[p.start : p.stop]) for p in pieces]
    scans = np.array([p.stop - p.start for p in pieces], dtype=float)
    drift, failed = np.array(worst).T
    return Purity(
        len(pieces),
        float(scans.sum() / len(poses)),
        float(np.sum(scans * (failed <= 1.0)) / scans.sum()),
        float(np.sum(scans * drift) / scans.sum()),
    )


def _worst(poses: Array, truth: Array) -> tuple[float, float]:
    """Largest error of a pose seen from the first: m, and in units of a failure."""
    error = se2.between(se2.between(truth[0], truth), se2.between(poses[0], poses))
    return float(np.hypot(error[:, 0], error[:, 1]).max()), float(step_error(error).max())
