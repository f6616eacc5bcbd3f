"""The trials of the study: one tells what every measure said of a drive, the others let each cut it."""

from __future__ import annotations

import time
from collections.abc import Sequence
from itertools import product

import numpy as np

from scenarios.ablate.segmentation.drive import Driven, steps_of
from scenarios.sweep import Answer, Trial
from slam.se2 import Array

STUDY, DETECTION = "segmentation", "detection"


def trials(
    scenarios: Sequence[str], seeds: Sequence[int], cutters: Sequence[str], thorough: bool
) -> list[Trial]:
    """For every drive its detection, and a map for every cutter."""
    found = []
    for scenario, seed in product(scenarios, seeds):
        found.append(Trial(STUDY, scenario, seed, DETECTION))
        found += [Trial(STUDY, scenario, seed, cutter, {"thorough": thorough}) for cutter in cutters]
    return found


def answer(trial: Trial, driven: Driven) -> Answer:
    """What a trial found of a drive."""
    return detected(driven) if trial.method == DETECTION else cut(trial, driven)


def detected(driven: Driven) -> Answer:
    """Every measure of every step, and how often slamstitch's own front end was lost on the same drive."""
    from slam.odometry.tracker import FrontendConfig, track

    steps = steps_of(driven.recording, driven.track)
    ours = steps_of(driven.recording, track(driven.recording, FrontendConfig(), driven.scans))
    counts = {"steps_ours": len(ours.error), "lost_ours": int(ours.lost.sum())}
    return Answer([counts], steps.to_bytes())


def cut(trial: Trial, driven: Driven) -> Answer:
    """The pieces that a cutter makes of the drive, and the map that slamstitch makes of them; seconds are of
    processor time."""
    from scenarios.ablate.segmentation.cutting import LEAN, THOROUGH, called_lost, mapped, pieces_of
    from scenarios.evaluation.segmentation import purity

    recording, track = driven.recording, driven.track
    assert recording.truth is not None
    lost = called_lost(driven, trial.method)
    sound = purity(pieces_of(track, lost), track.poses, recording.truth)
    started = time.process_time()
    poses = mapped(driven, lost, THOROUGH if trial.config["thorough"] else LEAN)
    seconds = time.process_time() - started
    pieces = {"pieces": sound.count, "kept": sound.kept, "pure": sound.pure, "drift": sound.drift}
    return Answer([{**worth(poses, driven), **pieces, "seconds": seconds}])


def worth(poses: Array, driven: Driven) -> dict[str, float]:
    """``ate_rmse`` [m] and ``map_f1`` of poses ``(N, 3)`` as `scenarios.evaluation` has them; what else it
    measures would cost as much again."""
    from scenarios.evaluation.maps import f1, map_at, occupied_cells
    from scenarios.evaluation.trajectory import aligned

    recording = driven.recording
    assert recording.truth is not None
    best = aligned(poses, recording.truth)
    squared = np.sum((best - recording.truth)[:, :2] ** 2, axis=1)
    cells = occupied_cells(map_at(recording, best))
    return {"ate_rmse": float(np.sqrt(squared.mean())), "map_f1": f1(cells, occupied_cells(driven.true_map))}
