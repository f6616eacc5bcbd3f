"""The map of a drive that is cut where a measure says that the robot is lost."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np

from scenarios.ablate.segmentation.drive import LabelledDrive
from scenarios.evaluation.segmentation import true_errors
from slam import se2
from slam.odometry.dead_reckoning import DeadReckoning
from slam.odometry.segmentation import THRESHOLDS, Segment, SegmentationConfig, lost_steps, split_at_losses
from slam.odometry.track import Track, Verdict
from slam.recording import Recording
from slam.se2 import Array
from stitch.align import align
from stitch.mapping import MappingConfig
from stitch.mapping.bundle import BundleConfig, adjust_all_scans
from stitch.mapping.offline import close_drive
from stitch.mapping.submap_graph import LoopConfig

NEVER, TRUTH = "never", "truth"
"""References: nothing is cut, and just what was truly lost, the most that a measure can be worth."""

LEAST_STEPS = 5
"""Least matched steps of a segment, as in Formsma's thesis."""

THOROUGH = MappingConfig()
"""slamstitch's own settings, after ManifoldSLAM's front end."""

LEAN = replace(
    THOROUGH,
    loops=LoopConfig(length=4.0, candidates=2, rounds=1),
    bundle=BundleConfig(neighbours=5, per_pass=2, radii=(0.4, 0.2, 0.15)),
)
"""A third of its cost: longer pieces, fewer stitches tried, a smaller bundle."""


def predict_failures(drive: LabelledDrive, cutter: str) -> np.ndarray:
    """Scans ``(N,)`` bool at which a measure, at the threshold learnt for it, reports a failure."""
    track = drive.track
    if cutter == NEVER:
        return np.zeros(len(track), dtype=bool)
    if cutter == TRUTH:
        return true_errors(track, drive.recording) > 1.0
    rule = SegmentationConfig(rule="threshold", measure=cutter, threshold=THRESHOLDS[cutter])
    return lost_steps(track, rule)


def segments_from(track: Track, lost: np.ndarray) -> tuple[Segment, ...]:
    """The segments of the drive between the ``lost (N,)`` scans that are long enough."""
    return split_at_losses(lost, track.verdict == Verdict.SKIPPED, LEAST_STEPS)


def splice_dead_reckoning(recording: Recording, track: Track, lost: np.ndarray) -> Track:
    """The track with dead reckoning in place of the ``lost (N,)`` steps; every other step stays as the front
    end accepted it."""
    reckoning = DeadReckoning(recording)
    poses, steps = track.poses.copy(), se2.between(track.poses[track.reference], track.poses)
    last = 0
    for k in range(1, len(poses)):
        if track.verdict[k] == Verdict.SKIPPED:
            poses[k] = poses[last]
            continue
        poses[k] = (
            reckoning.predict(last, k, poses[last])
            if lost[k]
            else se2.compose(poses[track.reference[k]], steps[k])
        )
        last = k
    return replace(track, poses=poses, verdict=np.where(lost, Verdict.FELL_BACK, track.verdict))


def map_with_cuts(drive: LabelledDrive, lost: np.ndarray, config: MappingConfig) -> Array:
    """Poses ``(N, 3)`` of the drive cut at the ``lost (N,)`` scans, after slamstitch's back end."""
    recording, scans = drive.recording, drive.scans
    spliced = splice_dead_reckoning(recording, drive.track, lost)
    stitch, reckoning = partial(align, config=config.loops.align), DeadReckoning(recording)
    closed = close_drive(reckoning, scans, spliced, segments_from(spliced, lost), config, stitch)
    if closed is None:
        return spliced.poses
    matched = spliced.verdict != Verdict.FELL_BACK
    return adjust_all_scans(reckoning, scans, closed.poses, matched, config.bundle)[0]
