"""The trials of the study: one computes every measure of a drive, the others map it cut by one of them."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from itertools import product

import numpy as np

from scenarios.ablate.segmentation.drive import LabelledDrive, steps_of
from scenarios.evaluation.maps import f1, map_at, occupied_cells
from scenarios.evaluation.segmentation import purity, true_errors
from scenarios.evaluation.trajectory import aligned
from scenarios.sweep import Answer, Trial
from slam import se2
from slam.odometry.dead_reckoning import DeadReckoning
from slam.odometry.segmentation import THRESHOLDS, Segment, SegmentationConfig, lost_steps, split_at_losses
from slam.odometry.track import Track, Verdict
from slam.odometry.tracker import FrontendConfig, track
from slam.recording import Recording
from slam.se2 import Array
from stitch.align import align
from stitch.mapping import MappingConfig
from stitch.mapping.bundle import BundleConfig, adjust_all_scans
from stitch.mapping.offline import close_drive
from stitch.mapping.submap_graph import LoopConfig

STUDY, DETECTION = "segmentation", "detection"
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


def trials(
    scenarios: Sequence[str], seeds: Sequence[int], cutters: Sequence[str], thorough: bool
) -> list[Trial]:
    """For every drive its detection, and a map for every cutter."""
    listed = []
    for scenario, seed in product(scenarios, seeds):
        listed.append(Trial(STUDY, scenario, seed, DETECTION))
        listed += [Trial(STUDY, scenario, seed, cutter, {"thorough": thorough}) for cutter in cutters]
    return listed


def run_trial(trial: Trial, drive: LabelledDrive) -> Answer:
    """The result of a trial on its drive."""
    return detect_failures(drive) if trial.method == DETECTION else map_cut_drive(trial, drive)


def detect_failures(drive: LabelledDrive) -> Answer:
    """Every measure of every step, and how often slamstitch's own front end was lost on the same drive."""
    steps = steps_of(drive.recording, drive.track)
    ours = steps_of(drive.recording, track(drive.recording, FrontendConfig(), drive.scans))
    counts = {"steps_ours": len(ours.error), "lost_ours": int(ours.lost.sum())}
    return Answer([counts], steps.to_bytes())


def map_cut_drive(trial: Trial, drive: LabelledDrive) -> Answer:
    """The segments that a cutter makes of the drive, the map that slamstitch makes of them, and its processor
    time [s]."""
    recording, track = drive.recording, drive.track
    assert recording.truth is not None
    lost = predict_failures(drive, trial.method)
    sound = purity(segments_from(track, lost), track.poses, recording.truth)
    started = time.process_time()
    poses = map_with_cuts(drive, lost, THOROUGH if trial.config["thorough"] else LEAN)
    seconds = time.process_time() - started
    pieces = {"pieces": sound.count, "kept": sound.kept, "pure": sound.pure, "drift": sound.drift}
    return Answer([{**trajectory_scores(poses, drive), **pieces, "seconds": seconds}])


def trajectory_scores(poses: Array, drive: LabelledDrive) -> dict[str, float]:
    """``ate_rmse`` [m] and ``map_f1`` of poses ``(N, 3)`` as `scenarios.evaluation` has them, without its
    other metrics, which would cost as much again."""
    recording = drive.recording
    assert recording.truth is not None
    best = aligned(poses, recording.truth)
    squared = np.sum((best - recording.truth)[:, :2] ** 2, axis=1)
    cells = occupied_cells(map_at(recording, best))
    return {"ate_rmse": float(np.sqrt(squared.mean())), "map_f1": f1(cells, occupied_cells(drive.true_map))}


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
    drive_closed = close_drive(reckoning, scans, spliced, segments_from(spliced, lost), config, stitch)
    if drive_closed is None:
        return spliced.poses
    matched = spliced.verdict != Verdict.FELL_BACK
    return adjust_all_scans(reckoning, scans, drive_closed[2], matched, config.bundle)[0]
