"""The map of a drive when a measure does the cutting."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
from stitch.mapping.adjusted import adjusted

from scenarios.ablate.segmentation.drive import Driven
from scenarios.evaluation.segmentation import true_errors
from scenarios.methods.config import MethodConfig
from slam import se2
from slam.odometry import dead_reckoning
from slam.odometry.segmentation import THRESHOLDS, Segment, SegmentationConfig, lost_steps
from slam.odometry.track import Track, Verdict
from slam.recording import Recording
from slam.se2 import Array
from stitch.align import align
from stitch.mapping.bundle import BundleConfig
from stitch.mapping.loop_closure import LoopConfig
from stitch.mapping.offline import stitched

NEVER, TRUTH = "never", "truth"
"""Nothing is cut, and just what was truly lost: what the choice of a measure can be worth at most."""

LEAST_STEPS = 5
"""Matched steps that a piece needs, as in the report."""

THOROUGH = MethodConfig()
"""slamstitch as it is, after ManifoldSLAM's front end."""

LEAN = replace(
    THOROUGH,
    loops=LoopConfig(length=4.0, candidates=2, rounds=1),
    bundle=BundleConfig(neighbours=5, per_pass=2, radii=(0.4, 0.2, 0.15)),
)
"""A third of its cost: longer pieces, fewer stitches tried, a smaller bundle."""


def called_lost(driven: Driven, cutter: str) -> np.ndarray:
    """Scans ``(N,)`` bool at which a measure, at the threshold learnt for it, says that the robot is lost."""
    track = driven.track
    if cutter == NEVER:
        return np.zeros(len(track), dtype=bool)
    if cutter == TRUTH:
        return true_errors(track, driven.recording) > 1.0
    rule = SegmentationConfig(rule="threshold", measure=cutter, threshold=THRESHOLDS[cutter])
    return lost_steps(track, rule)


def pieces_of(track: Track, lost: np.ndarray) -> tuple[Segment, ...]:
    """The stretches of the drive between lost scans that are long enough."""
    return between(lost, track.verdict == Verdict.SKIPPED, LEAST_STEPS)


def relaid(recording: Recording, track: Track, lost: np.ndarray) -> Track:
    """The track with what is called lost taken out: there, and only there, the pose follows dead reckoning;
    every other step stays as the front end accepted it, believed or not."""
    poses, steps = track.poses.copy(), se2.between(track.poses[track.reference], track.poses)
    last = 0
    for k in range(1, len(poses)):
        if track.verdict[k] == Verdict.SKIPPED:
            poses[k] = poses[last]
            continue
        poses[k] = (
            dead_reckoning.predict(recording, last, k, poses[last])
            if lost[k]
            else se2.compose(poses[track.reference[k]], steps[k])
        )
        last = k
    return replace(track, poses=poses, verdict=np.where(lost, Verdict.FELL_BACK, track.verdict))


def mapped(driven: Driven, lost: np.ndarray, config: MethodConfig) -> Array:
    """Poses ``(N, 3)`` after the pieces between the ``lost (N,)`` scans were stitched, closed and adjusted as
    slamstitch does."""
    recording, scans = driven.recording, driven.scans
    found = relaid(recording, driven.track, lost)
    stitch = partial(align, config=config.loops.align)
    drive = stitched(recording, scans, found, pieces_of(found, lost), config, stitch)
    if drive is None:
        return found.poses
    return adjusted(recording, scans, drive.poses, found.verdict != Verdict.FELL_BACK, config.bundle)[0]
