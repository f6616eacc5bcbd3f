"""What holds a drive together without stitches: the track where it matched, dead reckoning throughout."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from slam.graph import odometry_factors
from slam.graph.pose_graph import PoseGraph
from slam.odometry.track import Track, Verdict
from slam.recording import Recording
from slam.se2 import Array


def tracked(recording: Recording, found: Track, rows: np.ndarray) -> PoseGraph:
    """The graph of the scans ``rows (K,)`` whose track says nothing across lost scans.

    There the track repeats dead reckoning, which has edges of its own; an INS's step, made in its world
    frame, was turned into a relative pose by a yaw that may be wrong by what a fall turned it.
    """
    graph = odometry_factors.backbone(recording, found, rows)
    information = graph.information.copy()
    information[: len(rows) - 1][across_lost(found, rows)] = 0.0
    return with_heavy_tails(replace(graph, information=information), recording, len(rows) - 1)


def reckoned(recording: Recording, poses: Array, rows: np.ndarray) -> PoseGraph:
    """The graph of `slam.graph.odometry_factors.reckoning`: dead reckoning alone."""
    return with_heavy_tails(odometry_factors.reckoning(recording, poses, rows), recording, 0)


def across_lost(found: Track, rows: np.ndarray) -> np.ndarray:
    """Steps ``(K - 1,)`` bool between scans ``rows (K,)`` with a scan among them that was not matched."""
    lost = np.cumsum(found.verdict == Verdict.FELL_BACK)
    return np.diff(lost[rows]) > 0


def with_heavy_tails(graph: PoseGraph, recording: Recording, first: int) -> PoseGraph:
    """The graph, whose edges from ``first`` on are dead reckoning's, with an INS's yaw among them as
    heavy-tailed: a fall turns it by ten degrees and more."""
    heavy = graph.heavy_tailed.copy()
    heavy[first:] = recording.source == "ins"
    return replace(graph, heavy_tailed=heavy)
