"""The trials of the study: one computes every measure of a drive, the others map it cut by one of them."""

from __future__ import annotations

import time
from collections.abc import Sequence
from itertools import product

import numpy as np

from scenarios.ablate.segmentation.drive import LabelledDrive, steps_of
from scenarios.sweep import Answer, Trial
from slam.se2 import Array

STUDY, DETECTION = "segmentation", "detection"


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
    from slam.odometry.tracker import FrontendConfig, track

    steps = steps_of(drive.recording, drive.track)
    ours = steps_of(drive.recording, track(drive.recording, FrontendConfig(), drive.scans))
    counts = {"steps_ours": len(ours.error), "lost_ours": int(ours.lost.sum())}
    return Answer([counts], steps.to_bytes())


def map_cut_drive(trial: Trial, drive: LabelledDrive) -> Answer:
    """The segments that a cutter makes of the drive, the map that slamstitch makes of them, and its processor
    time [s]."""
    from scenarios.ablate.segmentation.cutting import (
        LEAN,
        THOROUGH,
        map_with_cuts,
        predict_failures,
        segments_from,
    )
    from scenarios.evaluation.segmentation import purity

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
    from scenarios.evaluation.maps import f1, map_at, occupied_cells
    from scenarios.evaluation.trajectory import aligned

    recording = drive.recording
    assert recording.truth is not None
    best = aligned(poses, recording.truth)
    squared = np.sum((best - recording.truth)[:, :2] ** 2, axis=1)
    cells = occupied_cells(map_at(recording, best))
    return {"ate_rmse": float(np.sqrt(squared.mean())), "map_f1": f1(cells, occupied_cells(drive.true_map))}
