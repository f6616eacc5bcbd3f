"""A whole recording becomes a map: track, cut, stitch, close the loops, adjust the bundle."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from slam.graph.odometry_factors import odometry_graph
from slam.mapping import keyframes
from slam.odometry.dead_reckoning import DeadReckoning
from slam.odometry.ego_motion_filter import remove_co_moving_points
from slam.odometry.laser_mount import Mount, find_mount
from slam.odometry.mending import track_mended
from slam.odometry.segmentation import Segment, segments
from slam.odometry.track import Track, Verdict
from slam.recording import Recording
from slam.scan import Scan, scans_of
from slam.se2 import Array
from stitch.align import align
from stitch.mapping.bundle import adjust_all_scans
from stitch.mapping.config import MappingConfig
from stitch.mapping.estimate import Estimate, NoEstimate, rejection_reason
from stitch.mapping.loop_closure import LoopClosureResult, Stitcher, close_loops, reject_inconsistent_loops
from stitch.mapping.submap_graph import SubmapGraph
from stitch.mapping.submaps import SubmapBuilder, gap_nodes, split_by_length, trim_relocalisation_jump

Revise = Callable[[LoopClosureResult, Array], LoopClosureResult]
"""What an ablation makes of the closed loops, given the poses ``(L, 3)`` of the nodes before."""


def map_recording(
    recording: Recording, config: MappingConfig = MappingConfig(), revise: Revise | None = None
) -> Estimate | NoEstimate:
    """The map of a recording: poses ``(N, 3)`` of all scans with covariances, submaps and stitches.

    The laser's mount is estimated where nobody states it. Without dead reckoning a map that knows it is lost
    is refused: `NoEstimate` says why. ``revise`` is for ablations: what it makes of the closed loops counts.
    """
    mount = find_mount(recording, config.frontend, config.mount, config.mending)
    if isinstance(mount, Mount):
        recording = recording.with_laser_mount(mount.T_robot_laser, "the drive")
    scans = scans_of(recording, config.frontend.scan)
    scans = remove_co_moving_points(recording, scans, config.ego_motion_filter)
    drive = track_mended(recording, config.frontend, config.mending, scans)
    stitch = partial(align, config=config.loops.align)
    reckoned = replace(config, frontend=replace(config.frontend, dead_reckoning=drive.reckoning))
    estimate = build_map(drive.recording, scans, drive.track, reckoned, stitch, revise)
    reason = rejection_reason(estimate, config.rejection) if recording.source == "none" else None
    if reason:
        return NoEstimate("slamstitch", reason)
    found = mount if isinstance(mount, Mount) else None
    return replace(estimate, laser_mount=found, odometry_faults=drive.faults)


def build_map(
    recording: Recording,
    scans: Sequence[Scan],
    tracked: Track,
    config: MappingConfig,
    stitch: Stitcher,
    revise: Revise | None = None,
) -> Estimate:
    """What follows a front end's track: cut, stitch by ``stitch``, close the loops, adjust."""
    doubted = tracked.contradicted if recording.source == "odometry" and tracked.contradicted.any() else None
    reckoning = DeadReckoning(recording, config.frontend.dead_reckoning, doubted)
    steady = segments(tracked, config.segmentation)
    drive = close_drive(reckoning, scans, tracked, steady, config, stitch, revise)
    if drive is None:
        return Estimate("slamstitch", tracked.poses, track=tracked)
    closed, nodes, poses = drive
    matched = tracked.verdict != Verdict.FELL_BACK
    poses, covariance = adjust_all_scans(
        reckoning, scans, poses, matched, config.bundle, config.keyframes, config.odometry
    )
    anchors = poses[[submap.start for submap in closed.submaps]]
    return Estimate(
        "slamstitch",
        poses,
        covariance=covariance,
        track=tracked,
        submaps=closed.submaps,
        stitches=reject_inconsistent_loops(closed.tried, anchors, config.loops.max_residual),
        graph_before=replace(closed.graph, poses=tracked.poses[nodes]),
        graph_after=replace(closed.graph, poses=closed.poses),
    )


def close_drive(
    reckoning: DeadReckoning,
    scans: Sequence[Scan],
    tracked: Track,
    steady: Sequence[Segment],
    config: MappingConfig,
    stitch: Stitcher,
    revise: Revise | None = None,
) -> tuple[LoopClosureResult, np.ndarray, Array] | None:
    """The ``steady`` segments of a track cut into submaps, stitched and closed; None where there is none, too
    little being matched to be a map.

    Returns the closed loops, the scans ``(L,)`` that are nodes of their graph, and the poses ``(N, 3)`` that
    this leaves.
    """
    recording = reckoning.measurements
    assert isinstance(recording, Recording)
    if not steady:
        return None
    steady = [trim_relocalisation_jump(recording, tracked, s, config.submaps) for s in steady]
    stretches = split_by_length(tracked, steady, config.loops.length)
    anchors = np.array([s.start for s in stretches])
    nodes = np.union1d(anchors, gap_nodes(tracked, stretches, config.submaps.gap_spacing))
    rows = keyframes.choose(tracked.poses, config.keyframes)
    drawable = rows[tracked.verdict[rows] != Verdict.FELL_BACK]
    builder = SubmapBuilder(recording, scans, drawable, tracked.poses, nodes, config.submaps)
    submaps = [builder.draw(tracked.poses, s.start, s.stop) for s in stretches]
    odometry = odometry_graph(reckoning, tracked, nodes, config.odometry)
    graph = SubmapGraph(submaps, odometry, recording.source, config.loops, np.searchsorted(nodes, anchors))
    closed = close_loops(graph, stitch, builder.redraw)
    if revise is not None:
        closed = revise(closed, odometry.poses)
    return closed, nodes, keyframes.carry(tracked.poses, nodes, closed.poses)
