"""Our method: track, cut, stitch, close, adjust."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from itertools import pairwise

import numpy as np

from scenarios.estimate import Estimate
from scenarios.methods.config import MethodConfig
from scenarios.methods.loops import Stitcher, close, with_false
from slam import bundle, chain, keyframes, se2
from slam.companions import without_companions
from slam.frontend import track
from slam.posegraph import marginals, optimise
from slam.recording import Recording
from slam.scan import Scan, scans_of
from slam.segmentation import Segment, segments
from slam.submap import cut
from slam.track import Track, Verdict
from stitch.align import align


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
    matched = found.verdict != Verdict.FELL_BACK
    drawn = np.array([k for k in keyframes.choose(found.poses) if matched[k]])
    stretches = chop(found, segments(found, config.segmentation), config.loops.length)
    if not stretches:  # too little was matched to be a map
        return Estimate(method, found.poses, track=found)
    submaps = [
        cut(recording, scans, found.poses, s.start, s.stop, np.union1d(drawn, s.start)) for s in stretches
    ]
    anchors = np.array([s.start for s in stretches])
    backbone = chain.backbone(recording, found, anchors)
    closed = close(submaps, backbone, recording.source, config.loops, stitch)
    if config.loops.injected > 0.0:
        rng = np.random.default_rng(config.loops.injected_seed)
        closed = with_false(closed, backbone.poses, config.loops, rng)
    poses = keyframes.carry(found.poses, anchors, closed.poses)
    rows = keyframes.choose(poses)
    reckoned = chain.reckoning(recording, poses, rows)
    graph = bundle.adjust([scans[k] for k in rows], reckoned, matched[rows], config.bundle)
    settled = optimise(graph, "none")
    return Estimate(
        method,
        keyframes.carry(poses, rows, settled.poses),
        covariance=marginals(graph, settled)[keyframes.nearest(rows, len(recording))],
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
        pieces += [Segment(stretch.start + int(a), stretch.start + int(b)) for a, b in pairwise(edges)]
    return pieces
