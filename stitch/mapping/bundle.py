"""Bundle adjustment of scans: neighbouring keyframes matched pairwise, again and again, all poses solved
at once.

What all poses cost at once grows with the square of the passes tied to each other. So where enough passes
have seen a place, later ones are placed in the map of the others, which stays as it is (Kretzschmar &
Stachniss 2012 leave them out: they say little new).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from slam import se2
from slam.graph.gauss_newton import ITERATIONS, Problem
from slam.graph.odometry_factors import SHARED_ERROR
from slam.graph.pose_graph import PoseGraph
from slam.matching import Reference
from slam.matching.reference import SCAN_CELL
from slam.scan import Scan
from slam.se2 import Array

DOUBT = 6.0
"""See `BundleConfig`; set on drives through outdoor, office_smoke and two_drives, seeds 100 to 103."""

STEPS = 3
"""Gauss-Newton steps of all poses in a round; the next round's matches say more than further ones."""

SAME_PLACE, SAME_VIEW = 1.0, np.radians(45.0)
"""Keyframes within this (m, rad) of each other see the same."""

SIDE = 32
"""Buckets along a side of a keyframe's lattice: there are many, and they are kept."""

ONE_PASS = 20
"""Keyframes this near to each other in the drive belong to one pass."""


@dataclass(frozen=True)
class BundleConfig:
    """Each keyframe is matched to at most ``neighbours`` earlier ones within ``reach`` m, at most
    ``per_pass`` of them from one stretch of the drive. One round per entry of ``radii`` (correspondence
    distance, m); ``robust`` the χ² at which a pair of points counts half. ``fade`` is the mean
    information below which a direction fades out. Scans whose points lie within ``level_misfit`` (mean χ²) of
    each other's lines saw one plane of the world; others were tilted or off the floor, which moves them all
    alike, and count less by the power `DOUBT`. ``passes`` past a place make its map.
    """

    neighbours: int = 14
    per_pass: int = 5
    reach: float = 3.0
    radii: tuple[float, ...] = (0.4, 0.4, 0.25, 0.25, 0.15, 0.15, 0.15)
    robust: float = 9.0
    fade: float = 0.02
    length: float = 2.0
    least_pairs: int = 15
    level_misfit: float = 0.8
    passes: int = 3


def mapping(poses: Array, usable: np.ndarray, config: BundleConfig) -> np.ndarray:
    """Which keyframes ``(K,)`` bool the map is made of: those that see what fewer than ``config.passes`` of
    them saw before, and those not ``usable (K,)`` on the way from one to the next of these."""
    tree = cKDTree(poses[:, :2])
    needed = usable.copy()
    for j in np.flatnonzero(usable):
        near = np.array(tree.query_ball_point(poses[j, :2], SAME_PLACE))
        near = np.sort(near[(near < j - ONE_PASS) & needed[near]])
        alike = near[np.abs(se2.wrap(poses[near, 2] - poses[j, 2])) <= SAME_VIEW]
        passes = int(np.sum(np.diff(alike) > ONE_PASS)) + (len(alike) > 0)
        needed[j] = passes < config.passes
    ends = np.flatnonzero(usable)
    before = np.searchsorted(ends, np.arange(len(poses)), side="right") - 1
    for j in np.flatnonzero(~usable):
        around = ends[max(before[j], 0) : before[j] + 2]
        needed[j] = bool(np.all(needed[around]))
    return needed


def adjust(
    scans: Sequence[Scan],
    backbone: PoseGraph,
    usable: np.ndarray,
    config: BundleConfig,
    held: np.ndarray | None = None,
) -> PoseGraph:
    """The graph of keyframes with its poses ``(K, 3)`` adjusted and the last round's pairs as its edges.

    ``scans`` are the K keyframes in the robot's frame; ``usable (K,)`` bool marks those that may be matched.
    ``backbone`` holds what is not matched here (dead reckoning), at the poses to start from. Those that
    ``held (K,)`` bool marks (default: none) stay where they are, and the others are matched to them alone.
    """
    cloud = _Cloud.of(scans)
    pairs = neighbours(backbone.poses, usable, config, held)
    graph = backbone
    for radius in config.radii:
        seen, T_ij, information, misfit = cloud.linearised(graph.poses, pairs, radius, config)
        graph = _with_pairs(replace(backbone, poses=graph.poses), seen, T_ij, information)
        graph = _descended(graph, held, STEPS)
    doubt = np.maximum(1.0, misfit / config.level_misfit) ** DOUBT
    graph = _with_pairs(replace(backbone, poses=graph.poses), seen, T_ij, information / doubt[:, None, None])
    return _descended(graph, held)


def _descended(graph: PoseGraph, held: np.ndarray | None, steps: int = ITERATIONS) -> PoseGraph:
    weights = np.ones(len(graph.edges))
    return replace(graph, poses=Problem.of(graph, held).descend(graph.poses, weights, steps))


@dataclass(frozen=True)
class _Cloud:
    """All keyframes packed for the kernel: scan k in rows ``offsets[k]:offsets[k + 1]``, with its lattice."""

    arrays: tuple[Array, ...]
    offsets: np.ndarray
    lattice: tuple[Any, ...]

    @classmethod
    def of(cls, scans: Sequence[Scan]) -> _Cloud:
        """The cloud of scans in the robot's frame; their points keep their order."""
        from slam.matching.neighbours import build

        clouds = [Reference(scan).cloud for scan in scans]
        lattices = [build(cloud[0], SCAN_CELL, SIDE) for cloud in clouds]
        cell, heads, following = zip(*lattices, strict=True)
        arrays = tuple(np.concatenate(parts) for parts in zip(*clouds, strict=True))
        offsets = np.concatenate([[0], np.cumsum([len(scan) for scan in scans])]).astype(np.int64)
        return cls(arrays, offsets, (cell[0], np.stack(heads), np.concatenate(following)))

    def linearised(
        self, poses: Array, pairs: np.ndarray, radius: float, config: BundleConfig
    ) -> tuple[np.ndarray, Array, Array, Array]:
        """Pairs that see each other, their relative poses ``T_ij`` one step on, the information in the body
        of j, and how far their points are off (mean robust χ²)."""
        from slam.matching.kernels import linearise_pairs

        guesses = se2.between(poses[pairs[:, 0]], poses[pairs[:, 1]])
        T_ij, information, used, misfit = linearise_pairs(
            self.arrays, self.offsets, self.lattice, pairs, guesses, radius,
            config.robust, config.fade, config.length,
        )  # fmt: skip
        known = used >= config.least_pairs
        in_body = se2.to_body_covariance(T_ij[known], information[known]) / SHARED_ERROR
        return pairs[known], T_ij[known], in_body, misfit[known]


def neighbours(
    poses: Array, usable: np.ndarray, config: BundleConfig, held: np.ndarray | None = None
) -> np.ndarray:
    """Pairs ``(P, 2)`` of keyframes i < j to match: near each other and from as many passes as there are;
    with some ``held``, these and the others."""
    first, second = (usable, usable) if held is None else (usable & held, usable & ~held)
    firsts = np.flatnonzero(first)
    tree = cKDTree(poses[firsts, :2])
    pairs = []
    for j in np.flatnonzero(second):
        near = firsts[np.sort(tree.query_ball_point(poses[j, :2], config.reach)).astype(np.int64)]
        pairs += [(int(i), int(j)) for i in neighbours_of(poses, int(j), near, config)]
    return np.array(pairs, dtype=np.int64).reshape(-1, 2)


def neighbours_of(poses: Array, j: int, near: np.ndarray, config: BundleConfig) -> np.ndarray:
    """Those of the keyframes ``near`` j, in ascending order, that j is to be matched to: earlier ones, the
    latest passes first."""
    near = np.asarray(near, dtype=np.int64)
    near = near[near < j]
    apart = np.linalg.norm(poses[near, :2] - poses[j, :2], axis=1)
    passes = np.split(np.arange(len(near)), np.flatnonzero(np.diff(near) > 1) + 1)
    chosen, found = [np.zeros(0, dtype=np.int64)], 0
    for run in reversed(passes):
        if found >= config.neighbours or len(run) == 0:
            break
        chosen.append(_spread(run, apart, config.per_pass))
        found += len(chosen[-1])
    return near[np.concatenate(chosen)[: config.neighbours]]


def _spread(run: np.ndarray, apart: Array, most: int) -> np.ndarray:
    """At most ``most`` members of a run: the nearest, then evenly spaced ones."""
    if len(run) <= most:
        return run
    even = run[np.linspace(0, len(run) - 1, most).round().astype(int)]
    even[int(np.argmin(apart[even]))] = run[int(np.argmin(apart[run]))]
    return np.unique(even)


def _with_pairs(backbone: PoseGraph, pairs: np.ndarray, T_ij: Array, information: Array) -> PoseGraph:
    return replace(
        backbone,
        edges=np.concatenate([backbone.edges, pairs]),
        T_ij=np.concatenate([backbone.T_ij, T_ij]),
        information=np.concatenate([backbone.information, information]),
        loop=np.zeros(len(backbone.edges) + len(pairs), dtype=bool),
        heavy_tailed=np.concatenate([backbone.heavy_tailed, np.zeros(len(pairs), dtype=bool)]),
    )
