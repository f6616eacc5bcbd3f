"""The thesis's method (Formsma): cut ManifoldSLAM's map where nothing matched, stitch the pieces in their
order."""

from __future__ import annotations

import numpy as np

from scenarios.methods.config import MethodConfig
from slam import se2
from slam.mapping.submap import cut
from slam.odometry.segmentation import segments
from slam.odometry.track import Verdict
from slam.odometry.tracker import track
from slam.recording import Recording
from slam.scan import scans_of
from stitch.align import Prior, Stitch, align
from stitch.mapping.estimate import Estimate, LoopCandidate

UNREAD = np.eye(3)
"""Covariance of a prior: the thesis's method reads the prior's rotation only."""


def stitch_in_sequence(recording: Recording, config: MethodConfig) -> Estimate:
    """Each piece is stitched to the map made of all pieces before it; the smallest rotation wins (Formsma
    §4.3).

    A lost scan stays with the piece before it; a piece that cannot be stitched stays where ManifoldSLAM
    had it.
    """
    scans = scans_of(recording, config.manifold.scan)
    tracked = track(recording, config.manifold, scans)
    matched = np.flatnonzero(tracked.verdict != Verdict.FELL_BACK)
    cuts = segments(tracked, config.htms.segmentation)
    resolution = config.htms.align.resolution
    pieces = [cut(recording, scans, tracked.poses, s.start, s.stop, matched, resolution) for s in cuts]
    inside = np.concatenate([np.arange(s.start, s.stop) for s in cuts] or [np.arange(0)])
    drawn = np.intersect1d(matched, inside)
    ends = [s.start for s in cuts[1:]] + [len(recording)]
    poses, tried = tracked.poses.copy(), []
    for b, piece in enumerate(pieces[1:], start=1):
        first = pieces[0]
        merged = cut(recording, scans, poses, first.start, piece.start, drawn, resolution)
        guess = Prior(se2.between(first.anchor, piece.anchor), UNREAD)
        result = align(merged, piece, guess, config.htms.align)
        tried.append(LoopCandidate(0, b, result))
        if isinstance(result, Stitch):
            anchor = se2.compose(first.anchor, result.T_a_b)
            rows = slice(piece.start, ends[b])
            poses[rows] = se2.compose(anchor, se2.between(piece.anchor, tracked.poses[rows]))
    return Estimate("htms", poses, track=tracked, submaps=tuple(pieces), stitches=tuple(tried))
