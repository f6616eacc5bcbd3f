"""Our method where nothing is left to find out about cuts and loops: the truth tells."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np

from scenarios.methods.config import MethodConfig
from slam import se2
from slam.cli import InputError
from slam.mapping.submap import Submap
from slam.odometry.dead_reckoning import DeadReckoning
from slam.odometry.ego_motion_filter import remove_co_moving_points
from slam.odometry.track import Track, Verdict
from slam.odometry.tracker import track
from slam.recording import Recording
from slam.scan import scans_of
from slam.se2 import Array
from stitch.align import AlignConfig, NoStitch, Prior, Stitch
from stitch.alignment.acceptance import measure_shared_area
from stitch.alignment.raster import walls_of
from stitch.alignment.refinement import covariance, score_field
from stitch.mapping.estimate import Estimate
from stitch.mapping.offline import build_map

FAILED_STEP = (0.10, np.radians(2.0))
"""A step of the front end that is off by more (m, rad) has failed, whatever its verdict says."""


def run(recording: Recording, config: MethodConfig) -> Estimate:
    """As slamstitch, but cut where the front end truly failed, and every overlap is stitched as it truly
    lies; the graph keeps all of these stitches, whatever its settings.

    Raises `InputError` for a recording without truth.
    """
    truth = recording.truth
    if truth is None:
        raise InputError(f"oracle: expected a recording with truth, {recording.name} has none")
    mapping = replace(config.slam, loops=replace(config.slam.loops, back_end="none"))
    scans = scans_of(recording, mapping.frontend.scan)
    scans = remove_co_moving_points(recording, scans, mapping.ego_motion_filter)
    tracked = track(recording, mapping.frontend, scans)
    reckoning = DeadReckoning(recording, mapping.frontend.dead_reckoning)
    tracked = with_true_failures(reckoning, tracked, truth, mapping.segmentation.measure)
    stitch = partial(true_stitch, truth=truth, config=mapping.loops.align)
    return replace(build_map(recording, scans, tracked, mapping, stitch), method="oracle")


def with_true_failures(reckoning: DeadReckoning, tracked: Track, truth: Array, measure: str) -> Track:
    """The track cut where it truly failed: there, and only there, ``measure`` says so and the pose follows
    dead reckoning."""
    failed = failures(tracked.poses, truth)
    poses = tracked.poses.copy()
    for k in range(1, len(poses)):
        poses[k] = (
            reckoning.predict(k - 1, k, poses[k - 1])
            if failed[k]
            else se2.compose(poses[k - 1], se2.between(tracked.poses[k - 1], tracked.poses[k]))
        )
    verdict = np.where(failed, Verdict.FELL_BACK, tracked.verdict)
    steady = np.where(np.isposinf(tracked.confidence[measure]), 0.0, tracked.confidence[measure])
    confidence = {**tracked.confidence, measure: np.where(failed, np.inf, steady)}
    return replace(tracked, poses=poses, verdict=verdict, confidence=confidence)


def failures(poses: Array, truth: Array) -> np.ndarray:
    """Scans ``(N,)`` bool whose step from the one before is off by more than `FAILED_STEP`."""
    error = se2.between(se2.between(truth[:-1], truth[1:]), se2.between(poses[:-1], poses[1:]))
    off = (np.hypot(error[:, 0], error[:, 1]) > FAILED_STEP[0]) | (np.abs(error[:, 2]) > FAILED_STEP[1])
    return np.concatenate([[False], off])


def true_stitch(a: Submap, b: Submap, prior: Prior, truth: Array, config: AlignConfig) -> Stitch | NoStitch:
    """Submap b as it truly lies in the frame of a, with the covariance that a search would state there.

    Maps that have too little in common, as the search counts it, are not stitched; where they lie is not
    asked of ``prior``.
    """
    T_a_b = se2.between(truth[a.start], truth[b.start])
    walls_a, walls_b = (walls_of(submap, config.resolution, config.walls) for submap in (a, b))
    if len(walls_a.points) == 0 or len(walls_b.points) == 0:
        return NoStitch("a submap has no occupied cells")
    still, moved = walls_a.raster(np.zeros(3), config.resolution), walls_b.raster(T_a_b, config.resolution)
    common = measure_shared_area(still, moved)
    limits = config.acceptance
    if common.overlap_area < limits.min_overlap or common.open_area < limits.min_open:
        return NoStitch("the maps have too little in common")
    field = score_field(walls_a, walls_b, None, config)
    sigma = covariance(field, T_a_b, walls_b.points.mean(axis=0))
    shared = float(field.agreement(T_a_b[None])[0])
    return Stitch(T_a_b, (sigma + sigma.T) / 2.0, shared, common.overlap_area, common.agreement)
