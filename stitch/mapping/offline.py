"""Our method: track, cut, stitch, close, adjust."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise

import numpy as np

from scenarios.methods.config import MethodConfig
from slam import se2
from slam.mapping import keyframes
from slam.mapping.submap import Submap, cut
from slam.odometry.ego_motion_filter import without_companions
from slam.odometry.segmentation import Segment, segments
from slam.odometry.track import Track, Verdict
from slam.odometry.tracker import track
from slam.recording import Recording
from slam.scan import Scan, scans_of
from slam.se2 import Array
from stitch.align import Stitch, align
from stitch.mapping import backbone as backbones
from stitch.mapping.adjusted import adjusted
from stitch.mapping.estimate import Estimate, LoopCandidate
from stitch.mapping.loop_closure import Closed, Stitcher, close, with_false

BENT = (0.05, 0.05, np.radians(1.0))
"""A submap is drawn anew when one of its scans moved further in it (m, m, rad): half a cell at 3 m."""

HEAD, JUMP = 3, np.radians(1.0)
"""Steps after a failure, and how much [rad] one of them may turn otherwise than dead reckoning says."""

POST = 1.0
"""Metres between the graph's nodes where nothing was matched."""

REFUTED = (0.2, 0.2, np.radians(1.5))
"""A stitch further off than this (m, m, rad) is not one on which the map rests."""


def run(recording: Recording, config: MethodConfig) -> Estimate:
    """Track the drive, cut it into submaps, stitch them where they meet, let the graph decide, adjust the
    bundle."""
    scans = without_companions(recording, scans_of(recording))
    found = track(recording, config.frontend, scans)
    stitch = partial(align, config=config.loops.align)
    return mapped("slamstitch", recording, scans, found, config, stitch)


def mapped(
    method: str,
    recording: Recording,
    scans: Sequence[Scan],
    found: Track,
    config: MethodConfig,
    stitch: Stitcher,
) -> Estimate:
    """What follows a front end's track: cut, stitch by ``stitch``, close, adjust."""
    drive = stitched(recording, scans, found, segments(found, config.segmentation), config, stitch)
    if drive is None:
        return Estimate(method, found.poses, track=found)
    matched = found.verdict != Verdict.FELL_BACK
    poses, covariance = adjusted(recording, scans, drive.poses, matched, config.bundle)
    return Estimate(
        method,
        poses,
        covariance=covariance,
        track=found,
        submaps=drive.closed.submaps,
        stitches=upheld(drive.closed.tried, poses[[submap.start for submap in drive.closed.submaps]]),
        graph_before=replace(drive.closed.graph, poses=found.poses[drive.nodes]),
        graph_after=replace(drive.closed.graph, poses=drive.closed.poses),
    )


@dataclass(frozen=True)
class Stitched:
    """A drive stitched: its loops ``closed`` between the scans ``nodes (L,)``, and the ``poses (N, 3)`` that
    this leaves."""

    closed: Closed
    nodes: np.ndarray
    poses: Array


def stitched(
    recording: Recording,
    scans: Sequence[Scan],
    found: Track,
    pieces: tuple[Segment, ...],
    config: MethodConfig,
    stitch: Stitcher,
) -> Stitched | None:
    """The ``pieces`` of a track cut into submaps, stitched and closed; None where there is no piece, too
    little being matched to be a map."""
    matched = found.verdict != Verdict.FELL_BACK
    drawn = np.array([k for k in keyframes.choose(found.poses) if matched[k]])
    if not pieces:
        return None
    stretches = chop(found, [settled_start(recording, found, piece) for piece in pieces], config.loops.length)
    anchors = np.array([s.start for s in stretches])
    nodes = np.union1d(anchors, between(found, stretches))
    pen = SubmapBuilder(recording, scans, drawn, found.poses, nodes)
    submaps = [pen.draw(found.poses, s.start, s.stop) for s in stretches]
    backbone = backbones.tracked(recording, found, nodes)
    closed = close(
        submaps, backbone, recording.source, config.loops, stitch, np.searchsorted(nodes, anchors), pen.redraw
    )
    if config.loops.injected > 0.0:
        rng = np.random.default_rng(config.loops.injected_seed)
        closed = with_false(closed, backbone.poses, config.loops, rng)
    return Stitched(closed, nodes, keyframes.carry(found.poses, nodes, closed.poses))


def upheld(tried: Sequence[LoopCandidate], anchors: Array) -> tuple[LoopCandidate, ...]:
    """Tried stitches, those switched off that the bundle refutes: it knows the scans of both submaps one by
    one, and has their ``anchors (S, 3)`` further apart from each other than `REFUTED`."""
    kept = []
    for one in tried:
        if isinstance(one.result, Stitch):
            off = np.abs(se2.between(one.result.T_a_b, se2.between(anchors[one.a], anchors[one.b])))
            one = replace(one, weight=0.0) if np.any(off > REFUTED) else one
        kept.append(one)
    return tuple(kept)


class SubmapBuilder:
    """Draws submaps of a drive, and anew where the graph has bent them.

    ``rows`` may be drawn, ``poses (N, 3)`` are the track's and ``nodes`` the scans that the graph places.
    """

    def __init__(
        self, recording: Recording, scans: Sequence[Scan], rows: np.ndarray, poses: Array, nodes: np.ndarray
    ) -> None:
        self.recording, self.scans, self.rows = recording, scans, rows
        self.poses, self.nodes = poses, nodes
        self.drawn = poses  # as each submap was last drawn

    def draw(self, poses: Array, start: int, stop: int) -> Submap:
        """Scans ``start..stop-1`` at ``poses (N, 3)``; its first is drawn whatever was said of it."""
        return cut(self.recording, self.scans, poses, start, stop, np.union1d(self.rows, start))

    def redraw(self, placed: Array, submaps: Sequence[Submap]) -> list[Submap]:
        """The submaps after the graph ``placed (K, 3)`` its nodes; those that hardly changed are kept."""
        poses = keyframes.carry(self.poses, self.nodes, placed)
        answer = []
        for submap in submaps:
            inside = slice(submap.start, submap.stop)
            before, after = (se2.between(p[submap.start], p[inside]) for p in (self.drawn, poses))
            moved = np.abs(se2.between(before, after)) > BENT
            answer.append(self.draw(poses, submap.start, submap.stop) if np.any(moved) else submap)
            if np.any(moved):
                self.drawn = self.drawn.copy()
                self.drawn[inside] = poses[inside]
        return answer


def settled_start(recording: Recording, found: Track, piece: Segment) -> Segment:
    """A piece without the scans at its head that were still matched to what was mapped before the failure.

    Where the track turns otherwise than dead reckoning within `HEAD` steps, it makes good what the failure
    left wrong, and what lies before is askew to the rest.
    """
    if piece.start == 0 or recording.source == "none":
        return piece
    rows = slice(piece.start, min(piece.start + HEAD + 1, piece.stop))
    turned = np.diff(found.poses[rows, 2]) - np.diff(recording.dead_reckoning[rows, 2])
    jumps = np.flatnonzero(np.abs(se2.wrap(turned)) > JUMP)
    return Segment(piece.start + int(jumps[-1]) + 1, piece.stop) if len(jumps) else piece


def between(found: Track, stretches: Sequence[Segment]) -> np.ndarray:
    """Scans about `POST` m apart, rows ``(P,)``, on the way between the stretches, to the first of them
    and from the last: there the graph has to follow dead reckoning, however that turned."""
    path = se2.path_length(found.poses)
    gaps = [(a.stop - 1, b.start) for a, b in pairwise(stretches) if a.stop != b.start]
    gaps = [(0, stretches[0].start), *gaps, (stretches[-1].stop - 1, len(path) - 1)]
    posts = [np.searchsorted(path, np.arange(path[i], path[j], POST)).clip(i, j) for i, j in gaps]
    return np.unique(np.concatenate([np.ravel(gaps), *posts]))


def chop(found: Track, stretches: Sequence[Segment], length: float) -> list[Segment]:
    """Segments cut further, so that none is longer than about ``length`` m of drive."""
    pieces = []
    for stretch in stretches:
        path = se2.path_length(found.poses[stretch.start : stretch.stop])
        count = max(1, round(float(path[-1]) / length))
        bounds = np.searchsorted(path, np.linspace(0.0, path[-1], count + 1)[1:-1])
        edges = np.unique([0, *bounds.tolist(), len(path)])
        pieces += [Segment(stretch.start + int(a), stretch.start + int(b)) for a, b in pairwise(edges)]
    return pieces
