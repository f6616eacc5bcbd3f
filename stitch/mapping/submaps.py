"""A track becomes submaps: stretches between losses, cut to length, drawn, and redrawn where the graph bends
them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from slam import se2
from slam.mapping import keyframes
from slam.mapping.submap import Submap, cut
from slam.odometry.segmentation import Segment
from slam.odometry.track import Track
from slam.recording import Recording
from slam.scan import Scan
from slam.se2 import Array


@dataclass(frozen=True)
class SubmapConfig:
    """How stretches of the drive become submaps."""

    resolution: float = 0.1
    """Cell size [m] of their occupancy grids."""
    settling_steps: int = 3
    """Steps after a failure in which the tracker may still jump back to what was mapped before."""
    settling_turn: float = np.radians(1.0)
    """A step turned by more [rad] than dead reckoning says is such a jump."""
    gap_spacing: float = 1.0
    """Metres between the graph's nodes where nothing was matched."""
    redraw_shift: float = 0.05
    """A submap is redrawn when one of its scans moved further in it [m] on an axis …"""
    redraw_turn: float = np.radians(1.0)
    """… or turned by more [rad]: half a cell at 3 m."""


def trim_relocalisation_jump(
    recording: Recording, track: Track, segment: Segment, config: SubmapConfig
) -> Segment:
    """A segment without the scans at its head that were still matched to what was mapped before the failure.

    Where the track turns otherwise than dead reckoning within `SubmapConfig.settling_steps`, it makes good
    what the failure left wrong, and what lies before is askew to the rest.
    """
    if segment.start == 0 or recording.source == "none":
        return segment
    rows = slice(segment.start, min(segment.start + config.settling_steps + 1, segment.stop))
    turned = np.diff(track.poses[rows, 2]) - np.diff(recording.dead_reckoning[rows, 2])
    jumps = np.flatnonzero(np.abs(se2.wrap(turned)) > config.settling_turn)
    return Segment(segment.start + int(jumps[-1]) + 1, segment.stop) if len(jumps) else segment


def split_by_length(track: Track, segments: Sequence[Segment], length: float) -> list[Segment]:
    """Segments cut further, so that none is longer than about ``length`` m of drive."""
    pieces = []
    for segment in segments:
        path = se2.path_length(track.poses[segment.start : segment.stop])
        count = max(1, round(float(path[-1]) / length))
        bounds = np.searchsorted(path, np.linspace(0.0, path[-1], count + 1)[1:-1])
        edges = np.unique([0, *bounds.tolist(), len(path)])
        pieces += [Segment(segment.start + int(a), segment.start + int(b)) for a, b in pairwise(edges)]
    return pieces


def gap_nodes(track: Track, segments: Sequence[Segment], spacing: float) -> np.ndarray:
    """Scans about ``spacing`` m apart, rows ``(P,)``, on the way between the segments, to the first of them
    and from the last: there the graph has to follow dead reckoning, however that turned."""
    path = se2.path_length(track.poses)
    gaps = [(a.stop - 1, b.start) for a, b in pairwise(segments) if a.stop != b.start]
    gaps = [(0, segments[0].start), *gaps, (segments[-1].stop - 1, len(path) - 1)]
    nodes = [np.searchsorted(path, np.arange(path[i], path[j], spacing)).clip(i, j) for i, j in gaps]
    return np.unique(np.concatenate([np.ravel(gaps), *nodes]))


class SubmapBuilder:
    """Draws submaps of a drive, and redraws those that the graph has bent.

    ``rows`` may be drawn, ``poses (N, 3)`` are the track's and ``nodes`` the scans that the graph places.
    """

    def __init__(
        self,
        recording: Recording,
        scans: Sequence[Scan],
        rows: np.ndarray,
        poses: Array,
        nodes: np.ndarray,
        config: SubmapConfig,
    ) -> None:
        self.recording, self.scans, self.rows = recording, scans, rows
        self.poses, self.nodes, self.config = poses, nodes, config
        self._drawn_poses = poses  # as each submap was last drawn

    def draw(self, poses: Array, start: int, stop: int) -> Submap:
        """Scans ``start..stop-1`` at ``poses (N, 3)``; the first is drawn even where it may not be."""
        rows, resolution = np.union1d(self.rows, start), self.config.resolution
        return cut(self.recording, self.scans, poses, start, stop, rows, resolution)

    def redraw(self, placed: Array, submaps: Sequence[Submap]) -> list[Submap]:
        """The submaps after the graph ``placed (K, 3)`` its nodes; those that hardly changed are kept."""
        poses = keyframes.carry(self.poses, self.nodes, placed)
        limit = (self.config.redraw_shift, self.config.redraw_shift, self.config.redraw_turn)
        redrawn = []
        for submap in submaps:
            inside = slice(submap.start, submap.stop)
            before, after = (se2.between(p[submap.start], p[inside]) for p in (self._drawn_poses, poses))
            bent = np.any(np.abs(se2.between(before, after)) > limit)
            redrawn.append(self.draw(poses, submap.start, submap.stop) if bent else submap)
            if bent:
                self._drawn_poses = self._drawn_poses.copy()
                self._drawn_poses[inside] = poses[inside]
        return redrawn
