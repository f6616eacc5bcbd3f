"""Bundle adjustment of scans: neighbouring keyframes matched pairwise, again and again, all poses solved at once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from slam import se2
from slam.chain import SHARED_ERROR
from slam.matching import Reference
from slam.posegraph import PoseGraph, optimise
from slam.scan import Scan
from slam.se2 import Array


@dataclass(frozen=True)
class BundleConfig:
    """Each keyframe is matched to at most ``neighbours`` earlier ones within ``reach`` m, at most ``per_pass`` of
    them from one stretch of the drive. One round per entry of ``radii`` (correspondence distance, m); ``robust``
    the χ² at which a pair of points counts half. ``fade`` is the mean information below which a direction fades out.
    """

    neighbours: int = 14
    per_pass: int = 5
    reach: float = 3.0
    radii: tuple[float, ...] = (0.4, 0.4, 0.25, 0.25, 0.15, 0.15, 0.15)
    robust: float = 9.0
    fade: float = 0.02
    length: float = 2.0
    least_pairs: int = 15


def adjust(scans: Sequence[Scan], backbone: PoseGraph, usable: np.ndarray, config: BundleConfig) -> PoseGraph:
    """The graph of keyframes with its poses ``(K, 3)`` adjusted and the last round's pairs as its edges.

    ``scans`` are the K keyframes in the robot's frame; ``usable (K,)`` bool marks those that may be matched.
    ``backbone`` holds what is not matched here (dead reckoning), at the poses to start from.
    """
    references = [Reference(scan) for scan in scans]
    pairs = neighbours(backbone.poses, usable, config)
    graph = backbone
    for radius in config.radii:
        linear = [_linearise(references, graph.poses, i, j, radius, config) for i, j in pairs]
        known = [(pair, *found) for pair, found in zip(pairs, linear, strict=True) if found is not None]
        graph = _with_pairs(replace(backbone, poses=graph.poses), known)
        graph = replace(graph, poses=optimise(graph, "none").poses)
    return graph


def neighbours(poses: Array, usable: np.ndarray, config: BundleConfig) -> np.ndarray:
    """Pairs ``(P, 2)`` of keyframes i < j to match: near each other and from as many passes as there are."""
    pairs = []
    for j in range(1, len(poses)):
        apart = np.linalg.norm(poses[:j, :2] - poses[j, :2], axis=1)
        near = np.flatnonzero((apart <= config.reach) & usable[:j]) if usable[j] else np.zeros(0, dtype=int)
        passes = np.split(near, np.flatnonzero(np.diff(near) > 1) + 1)
        chosen = [_spread(run, apart, config.per_pass) for run in passes[::-1] if len(run)]
        pairs += [(int(i), j) for i in np.concatenate(chosen or [near])[: config.neighbours]]
    return np.array(pairs, dtype=np.int64).reshape(-1, 2)


def _spread(run: np.ndarray, apart: Array, most: int) -> np.ndarray:
    """At most ``most`` members of a run: the nearest, then evenly spaced ones."""
    if len(run) <= most:
        return run
    even = run[np.linspace(0, len(run) - 1, most).round().astype(int)]
    even[int(np.argmin(apart[even]))] = run[int(np.argmin(apart[run]))]
    return np.unique(even)


def _linearise(
    references: list[Reference], poses: Array, i: int, j: int, radius: float, config: BundleConfig
) -> tuple[Array, Array] | None:
    """Relative pose ``T_ij`` one Gauss–Newton step on, and its information in the body of j; None without pairs."""
    from slam.matching import kernels

    first, second = references[i], references[j]
    guess = se2.between(poses[i], poses[j])
    matched = kernels.correspondences(
        first.arrays[0], first.index, second.arrays[0], second.index, guess, radius, False
    )
    information, gradient, used, _, total = kernels.normal_equations(
        kernels.PLICP, first.arrays, second.arrays, matched, guess, 1.0, config.robust
    )
    if used < config.least_pairs:
        return None
    information, gradient = kernels.fade_weak(information, gradient, total, config.length, config.fade)
    step = kernels.solve_good_directions(information, gradient, config.length, 1e-3)
    T_ij = guess + step
    return T_ij, se2.to_body_covariance(T_ij, information) / SHARED_ERROR


def _with_pairs(backbone: PoseGraph, known: list[tuple[np.ndarray, Array, Array]]) -> PoseGraph:
    pairs = np.array([pair for pair, _, _ in known], dtype=np.int64).reshape(-1, 2)
    return replace(
        backbone,
        edges=np.concatenate([backbone.edges, pairs]),
        T_ij=np.concatenate([backbone.T_ij, np.reshape([T for _, T, _ in known], (-1, 3))]),
        information=np.concatenate([backbone.information, np.reshape([L for *_, L in known], (-1, 3, 3))]),
        loop=np.zeros(len(backbone.edges) + len(pairs), dtype=bool),
    )
