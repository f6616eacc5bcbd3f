"""The bundle over a whole drive: the map first, then the keyframes that only lie in it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.spatial import cKDTree

from slam import se2
from slam.graph.gauss_newton import Problem
from slam.graph.pose_graph import PoseGraph
from slam.mapping import keyframes
from slam.recording import Recording
from slam.scan import Scan
from slam.se2 import Array
from stitch.mapping import backbone as backbones
from stitch.mapping import bundle
from stitch.mapping.bundle import BundleConfig

TIES, TIES_PER_PASS, LAST_ROUNDS = 10, 5, 4
"""Keyframes of the map that one which is placed in it is matched to, those of one pass, and the rounds: less
than in a bundle, as there is little left to find out."""


def adjusted(
    recording: Recording, scans: Sequence[Scan], poses: Array, matched: np.ndarray, config: BundleConfig
) -> tuple[Array, Array]:
    """Poses ``(N, 3)`` of all scans and their covariances ``(N, 3, 3)`` after the bundle, from ``poses`` on.

    ``matched (N,)`` bool marks the scans that may be matched. Keyframes that make the map are adjusted with
    each other; the rest follow those beside them, and are then adjusted to these, which stay.
    """
    rows = keyframes.choose(poses)
    before, usable = poses[rows], matched[rows]
    held = bundle.mapping(before, usable, config)
    reckoned = backbones.reckoned(recording, poses, rows[held])
    graph = bundle.adjust([scans[k] for k in rows[held]], reckoned, usable[held], config)
    after, covariance = before.copy(), np.zeros((len(rows), 3, 3))
    after[held], covariance[held] = graph.poses, _known(graph)
    if not np.all(held):
        firm = np.flatnonzero(held & usable)
        beside = firm[cKDTree(before[firm, :2]).query(before[~held, :2])[1]]
        after[~held] = se2.compose(after[beside], se2.between(before[beside], before[~held]))
        reckoned = replace(backbones.reckoned(recording, poses, rows), poses=after)
        few = replace(config, neighbours=TIES, per_pass=TIES_PER_PASS, radii=config.radii[-LAST_ROUNDS:])
        graph = bundle.adjust([scans[k] for k in rows], reckoned, usable, few, held)
        after = graph.poses
        of_map = se2.transport(covariance[beside], se2.between(after[~held], after[beside]))
        covariance[~held] = of_map + _known(graph, held)[~held]
    return keyframes.carry(poses, rows, after), covariance[keyframes.nearest(rows, len(recording))]


def _known(graph: PoseGraph, held: np.ndarray | None = None) -> Array:
    """Covariances ``(K, 3, 3)`` in the body frame at the graph's poses; given where the held ones are."""
    factor, _ = Problem.of(graph, held).factor(graph.poses, np.ones(len(graph.edges)))
    return factor.inverse_blocks()
