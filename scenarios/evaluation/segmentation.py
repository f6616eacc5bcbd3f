"""Against truth: the lost steps of a track, how sound the pieces are that a drive was cut into, and which of
their stitches are false."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from scenarios.evaluation.metric import NO_TRUTH, Definition, Values, absent
from slam import se2
from slam.mapping.submap import Submap
from slam.odometry.confidence import step_error
from slam.odometry.segmentation import Segment
from slam.odometry.track import Track
from slam.recording import Recording
from slam.se2 import Array
from stitch.align import Stitch
from stitch.mapping.estimate import Estimate, LoopCandidate

FALSE_TRANSLATION, FALSE_ROTATION = 0.3, np.radians(2.0)
"""An accepted stitch further off than this [m], [rad] is false."""

_UNTRIED = "Good stitches that were never tried; a stitch is judged at the first scans of its two segments."
DEFINITIONS = {
    "segments": Definition(
        "", None, "pieces the drive was cut into", "Whether the cuts are where the errors are."
    ),
    "stitches_tried": Definition("", None, "pairs of pieces that were tried", _UNTRIED),
    "stitches_accepted": Definition("", None, "stitches the final map rests on", _UNTRIED),
    "stitches_false": Definition("", "lower", "accepted and off by more than 0.3 m or 2°", _UNTRIED),
}


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


def segment_gaps(submaps: Sequence[Submap]) -> list[tuple[int, int]]:
    """First and last scan of every stretch between two submaps that belongs to none. Where two submaps touch,
    the drive was divided but not cut."""
    return [(a.stop, b.start - 1) for a, b in pairwise(submaps) if a.stop < b.start]


@dataclass(frozen=True)
class StitchError:
    """How far the alignment found for a pair of submaps is from the true one [m], [rad]."""

    translation: float
    rotation: float

    @property
    def false(self) -> bool:
        """True beyond 0.3 m or 2°."""
        return self.translation > FALSE_TRANSLATION or self.rotation > FALSE_ROTATION


def stitch_error(estimate: Estimate, stitch: LoopCandidate, truth: Array) -> StitchError | None:
    """The error of a tried stitch against ``truth (N, 3)``; None where no alignment was found. A submap's
    frame is the robot's pose at its first scan, so the true alignment is that between the true poses
    there."""
    if not isinstance(stitch.result, Stitch):
        return None
    a, b = estimate.submaps[stitch.a].start, estimate.submaps[stitch.b].start
    error = se2.between(se2.between(truth[a], truth[b]), stitch.result.T_a_b)
    return StitchError(float(np.hypot(error[0], error[1])), float(abs(error[2])))


def false_stitches(estimate: Estimate, truth: Array | None) -> frozenset[int]:
    """Indices of the accepted stitches that are false against ``truth (N, 3)``; none where there is none."""
    if truth is None:
        return frozenset()
    errors = [stitch_error(estimate, stitch, truth) for stitch in estimate.stitches]
    return frozenset(
        k
        for k, (stitch, error) in enumerate(zip(estimate.stitches, errors, strict=True))
        if stitch.accepted and error is not None and error.false
    )


def stitch_metrics(estimate: Estimate, truth: Array | None) -> Values:
    """Counts of segments and of stitches tried, accepted and false."""
    if not estimate.submaps:
        return absent(DEFINITIONS, "the method does not cut the drive")
    return {
        "segments": len(estimate.submaps),
        "stitches_tried": len(estimate.stitches),
        "stitches_accepted": sum(stitch.accepted for stitch in estimate.stitches),
        "stitches_false": NO_TRUTH if truth is None else len(false_stitches(estimate, truth)),
    }
