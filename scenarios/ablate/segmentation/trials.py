"""The trials of the study: one computes every measure of a drive, the others map it cut by one of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import product

import numpy as np

from scenarios.ablate.trial_io import pack, unpack
from scenarios.evaluation.maps import f1, map_at, occupied_cells, true_map
from scenarios.evaluation.segmentation import purity, true_errors
from scenarios.evaluation.trajectory import aligned
from scenarios.source import simulated
from scenarios.stages import timed
from scenarios.sweep import Answer, Trial
from slam import se2
from slam.mapping.occupancy import Grid
from slam.odometry.dead_reckoning import DeadReckoning
from slam.odometry.ego_motion_filter import remove_co_moving_points
from slam.odometry.segmentation import THRESHOLDS, Segment, SegmentationConfig, lost_steps, split_at_losses
from slam.odometry.track import Track, Verdict
from slam.odometry.tracker import MANIFOLD_SLAM, FrontendConfig, track
from slam.recording import Recording
from slam.scan import Scan, scans_of
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


@dataclass(frozen=True)
class LabelledDrive:
    """A recording with truth, its scans without co-moving points, the track of ManifoldSLAM's front end (ours
    is hardly ever lost), and the map drawn with true poses."""

    recording: Recording
    scans: list[Scan]
    track: Track
    true_map: Grid


@dataclass(frozen=True)
class Steps:
    """The M steps of a track that were tried: ``scan (M,)``, ``error (M,)`` in units of a failure, and every
    measure ``(M,)`` by name, +inf where nothing matched and NaN where it could not be measured."""

    scan: np.ndarray
    error: Array
    columns: dict[str, Array]

    @property
    def lost(self) -> np.ndarray:
        """Steps ``(M,)`` bool that are off by more than a failure."""
        return self.error > 1.0

    @property
    def matched(self) -> np.ndarray:
        """Steps ``(M,)`` bool with at least one match."""
        return np.isfinite(self.columns["neg_matches"])

    def to_bytes(self) -> bytes:
        """The steps as an .npz file."""
        return pack({"scan": self.scan, "error": self.error, **self.columns})

    @classmethod
    def from_bytes(cls, data: bytes) -> Steps:
        """What `to_bytes` wrote."""
        arrays = unpack(data)
        return cls(arrays.pop("scan"), arrays.pop("error"), arrays)


def label_drive(scenario: str, seed: int) -> LabelledDrive:
    """Simulate a drive and let ManifoldSLAM track it, once for all trials of the drive."""
    recording = simulated(scenario, seed).recording
    scans = remove_co_moving_points(recording, scans_of(recording))
    drawn = true_map(recording)
    assert drawn is not None
    return LabelledDrive(recording, scans, track(recording, MANIFOLD_SLAM, scans), drawn)


def steps_of(recording: Recording, track: Track) -> Steps:
    """The steps of a track. Raises ``ValueError`` for a recording without truth."""
    errors = true_errors(track, recording)
    rows = np.flatnonzero(np.isfinite(errors))
    return Steps(rows, errors[rows], {name: values[rows] for name, values in track.confidence.items()})


def trials(
    scenarios: Sequence[str], seeds: Sequence[int], cutters: Sequence[str], thorough: bool
) -> list[Trial]:
    """For every drive its detection, and a map for every cutter."""
    methods = [(DETECTION, {}), *((cutter, {"thorough": thorough}) for cutter in cutters)]
    return [Trial(STUDY, *drive, *method) for drive in product(scenarios, seeds) for method in methods]


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
    time [s]; of the metrics of `scenarios.evaluation` only two, as the others would cost as much again."""
    recording, track = drive.recording, drive.track
    assert recording.truth is not None
    lost = predict_failures(drive, trial.method)
    sound = purity(segments_from(track, lost), track.poses, recording.truth)
    poses, seconds = timed(map_with_cuts, drive, lost, THOROUGH if trial.config["thorough"] else LEAN)
    best = aligned(poses, recording.truth)
    squared = np.sum((best - recording.truth)[:, :2] ** 2, axis=1)
    right = f1(occupied_cells(map_at(recording, best)), occupied_cells(drive.true_map))
    scores = {"ate_rmse": float(np.sqrt(squared.mean())), "map_f1": right, "seconds": seconds}
    pieces = {"pieces": sound.count, "kept": sound.kept, "pure": sound.pure, "drift": sound.drift}
    return Answer([pieces | scores])


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
    """The track with dead reckoning in place of the ``lost (N,)`` steps, as it was at the others."""
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
