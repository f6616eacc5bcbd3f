"""The stitches of a method against truth."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scenarios.evaluation.metric import Metric, measured, missing
from slam import se2
from slam.se2 import Array
from stitch.align import Stitch
from stitch.mapping.estimate import Estimate, LoopCandidate

FALSE_TRANSLATION, FALSE_ROTATION = 0.3, np.radians(2.0)
"""An accepted stitch further off than this [m], [rad] is false."""

NAMES = ("segments", "stitches_tried", "stitches_accepted", "stitches_false")


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
    """The error of a tried stitch against ``truth (N, 3)``; None where no alignment was found.

    A submap's frame is the robot's pose at its first scan, so the true alignment is that between the true
    poses there.
    """
    if not isinstance(stitch.result, Stitch):
        return None
    a, b = estimate.submaps[stitch.a].start, estimate.submaps[stitch.b].start
    error = se2.between(se2.between(truth[a], truth[b]), stitch.result.T_a_b)
    return StitchError(float(np.hypot(error[0], error[1])), float(abs(error[2])))


def stitch_metrics(estimate: Estimate, truth: Array | None) -> list[Metric]:
    """Counts of segments and of stitches tried, accepted and false."""
    if not estimate.submaps:
        return missing(estimate.method, NAMES, "the method does not cut the drive")
    accepted = [stitch for stitch in estimate.stitches if stitch.accepted]
    counts = (len(estimate.submaps), len(estimate.stitches), len(accepted))
    metrics = measured(estimate.method, dict(zip(NAMES[:3], counts, strict=True)))
    if truth is None:
        return metrics + missing(estimate.method, NAMES[3:], "the recording has no truth")
    errors = [stitch_error(estimate, stitch, truth) for stitch in accepted]
    false = sum(error.false for error in errors if error is not None)
    return metrics + measured(estimate.method, {NAMES[3]: false})
