"""Our method: track, cut, stitch, close, adjust."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from scenarios.estimate import Estimate
from scenarios.methods.config import MethodConfig
from scenarios.methods.loops import close
from slam import bundle, chain, keyframes, se2
from slam.frontend import track
from slam.posegraph import PoseGraph
from slam.recording import Recording
from slam.scan import scans_of
from slam.segmentation import Segment, segments
from slam.se2 import Array
from slam.submap import cut
from slam.track import Track, Verdict


def run(recording: Recording, config: MethodConfig) -> Estimate:
    """Track the drive, cut it into submaps, stitch them where they meet, let the graph decide, adjust the bundle."""
    scans = scans_of(recording)
    found = track(recording, config.frontend)
    trusted = np.flatnonzero(found.verdict != Verdict.FELL_BACK)
    stretches = chop(found, segments(found, config.segmentation), config.loops.length)
    submaps = [cut(recording, scans, found.poses, s.start, s.stop, trusted) for s in stretches]
    anchors = np.array([s.start for s in stretches])
    closed = close(submaps, chain.backbone(recording, found, anchors), recording.source, config.loops)
    poses = keyframes.carry(found.poses, anchors, closed.poses)
    rows = keyframes.choose(poses)
    reckoned = reckoning(recording, found, rows, poses)
    usable = found.verdict[rows] != Verdict.FELL_BACK
    graph = bundle.adjust([scans[k] for k in rows], reckoned, usable, config.bundle)
    return Estimate(
        "slamstitch",
        keyframes.carry(poses, rows, graph.poses),
        track=found,
        submaps=tuple(submaps),
        stitches=closed.tried,
        graph_before=replace(closed.graph, poses=found.poses[anchors]),
        graph_after=replace(closed.graph, poses=closed.poses),
    )


def chop(found: Track, stretches: tuple[Segment, ...], length: float) -> list[Segment]:
    """Segments cut further, so that none is longer than about ``length`` m of drive."""
    pieces = []
    for stretch in stretches:
        path = se2.path_length(found.poses[stretch.start : stretch.stop])
        count = max(1, round(float(path[-1]) / length))
        bounds = np.searchsorted(path, np.linspace(0.0, path[-1], count + 1)[1:-1])
        edges = np.unique([0, *bounds.tolist(), len(path)])
        pieces += [Segment(stretch.start + int(a), stretch.start + int(b)) for a, b in zip(edges[:-1], edges[1:])]
    return pieces


def reckoning(recording: Recording, found: Track, rows: np.ndarray, poses: Array) -> PoseGraph:
    """Dead reckoning alone between the scans ``rows``, at ``poses``."""
    silent = replace(found, verdict=np.full(len(found), Verdict.FELL_BACK, dtype=np.int8))
    return replace(chain.backbone(recording, silent, rows), poses=poses[rows])
