"""Bundle adjustment: neighbouring keyframes matched pairwise, again and again, all poses solved at once.

Its cost grows with the square of the passes tied to each other. So where enough passes have seen a place,
later ones are placed in the map of the others (Kretzschmar & Stachniss 2012 leave them out).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from slam import se2
from slam.graph.odometry_factors import OdometryFactorConfig, dead_reckoning_graph
from slam.graph.pose_graph import PoseGraph
from slam.mapping import keyframes
from slam.mapping.keyframes import KeyframeConfig
from slam.matching import MatchConfig, Reference
from slam.odometry.dead_reckoning import DeadReckoning
from slam.scan import Scan
from slam.se2 import Array

SIDE = 32
"""Buckets along a side of a keyframe's lattice: there are many, and they are kept."""


@dataclass(frozen=True)
class BundleConfig:
    """Bundle adjustment of keyframes."""

    neighbours: int = 14
    """Earlier keyframes that each is matched to at most."""
    per_pass: int = 5
    """Those of them of one stretch of the drive at most."""
    reach: float = 3.0
    """Keyframes within this [m] are matched."""
    radii: tuple[float, ...] = (0.4, 0.4, 0.25, 0.25, 0.15, 0.15, 0.15)
    """Correspondence distances [m], one round each."""
    steps: int = 3
    """Gauss-Newton steps of all poses in a round; the next round's matches say more than further ones."""
    robust: float = 9.0
    """χ² at which a pair of points counts half."""
    fade: float = 0.02
    """Mean information of a point pair below which a direction fades out."""
    length: float = 2.0
    """Lever [m] by which angles and lengths are compared where directions fade out."""
    same_side: float = MatchConfig().same_side
    """Cosine between two normals from which they face the same way."""
    freeze_ratio: float = MatchConfig().freeze_ratio
    """Share of the strongest direction's information below which a step leaves a direction alone."""
    least_pairs: int = 15
    """Point pairs that a scan pair needs."""
    match_inflation: float = 25.0
    """Covariance inflation of a scan pair: neighbouring points share their errors."""
    level_misfit: float = 0.8
    """Mean χ² of a scan pair above which it is taken for tilted or off the floor, which moves all its
    points alike."""
    tilt_discount: float = 6.0
    """Such a pair's information is scaled by (level_misfit / χ²) to this power; set on drives through
    outdoor, office_smoke and two_drives, seeds 100 to 103."""
    passes: int = 3
    """Earlier passes by a place that make its map; later keyframes there are placed in it."""
    same_place: float = 1.0
    """Keyframes within this [m] of each other see the same …"""
    same_view: float = np.radians(45.0)
    """… if they are turned by less [rad]."""
    pass_gap: int = 20
    """Keyframes this near to each other in the drive belong to one pass."""
    placed_neighbours: int = 10
    """Keyframes of the map that each remaining one is matched to at most."""
    placed_per_pass: int = 5
    """Those of them of one pass."""
    placed_rounds: int = 4
    """Rounds for the remaining keyframes, the last of ``radii``: fewer, as the map is fixed."""


def adjust_all_scans(
    reckoning: DeadReckoning,
    scans: Sequence[Scan],
    poses: Array,
    matched: np.ndarray,
    config: BundleConfig,
    spacing: KeyframeConfig = KeyframeConfig(),
    odometry: OdometryFactorConfig = OdometryFactorConfig(),
) -> tuple[Array, Array]:
    """Poses ``(N, 3)`` of all scans and their covariances ``(N, 3, 3)`` after the bundle, from ``poses`` on.

    ``matched (N,)`` bool marks the scans that may be matched. Keyframes that make the map are adjusted with
    each other; the remaining ones are carried along with their neighbours, then optimised with the map fixed.
    """
    from slam.graph.gauss_newton import factor_of

    rows = keyframes.choose(poses, spacing)
    before, usable = poses[rows], matched[rows]
    in_map = select_map_keyframes(before, usable, config)
    factors = dead_reckoning_graph(reckoning, poses, rows[in_map], odometry)
    graph = adjust([scans[k] for k in rows[in_map]], factors, usable[in_map], config)
    after, covariance = before.copy(), np.zeros((len(rows), 3, 3))
    after[in_map] = graph.poses
    covariance[in_map] = factor_of(graph, graph.poses).inverse_blocks()
    if not np.all(in_map):
        firm = np.flatnonzero(in_map & usable)
        beside = firm[cKDTree(before[firm, :2]).query(before[~in_map, :2])[1]]
        after[~in_map] = se2.compose(after[beside], se2.between(before[beside], before[~in_map]))
        factors = replace(dead_reckoning_graph(reckoning, poses, rows, odometry), poses=after)
        radii = config.radii[-config.placed_rounds :]
        placing = replace(
            config, neighbours=config.placed_neighbours, per_pass=config.placed_per_pass, radii=radii
        )
        graph = adjust([scans[k] for k in rows], factors, usable, placing, in_map)
        after = graph.poses
        of_map = se2.transport(covariance[beside], se2.between(after[~in_map], after[beside]))
        own = factor_of(graph, graph.poses, in_map).inverse_blocks()
        covariance[~in_map] = of_map + own[~in_map]
    return keyframes.carry(poses, rows, after), covariance[keyframes.nearest(rows, len(poses))]


def select_map_keyframes(poses: Array, usable: np.ndarray, config: BundleConfig) -> np.ndarray:
    """Mask ``(K,)`` of the keyframes to optimise: one is left out where ``config.passes`` earlier passes have
    covered the same place; those not ``usable (K,)`` between two kept ones are kept, so that the graph stays
    connected."""
    tree = cKDTree(poses[:, :2])
    needed = usable.copy()
    for j in np.flatnonzero(usable):
        near = np.array(tree.query_ball_point(poses[j, :2], config.same_place))
        near = np.sort(near[(near < j - config.pass_gap) & needed[near]])
        alike = near[np.abs(se2.wrap(poses[near, 2] - poses[j, 2])) <= config.same_view]
        passes = int(np.sum(np.diff(alike) > config.pass_gap)) + (len(alike) > 0)
        needed[j] = passes < config.passes
    ends = np.flatnonzero(usable)
    before = np.searchsorted(ends, np.arange(len(poses)), side="right") - 1
    for j in np.flatnonzero(~usable):
        around = ends[max(before[j], 0) : before[j] + 2]
        needed[j] = bool(np.all(needed[around]))
    return needed


def adjust(
    scans: Sequence[Scan],
    factors: PoseGraph,
    usable: np.ndarray,
    config: BundleConfig,
    fixed: np.ndarray | None = None,
) -> PoseGraph:
    """The graph of keyframes with its poses ``(K, 3)`` adjusted and the last round's pairs as its edges.

    ``scans`` are the K keyframes in the robot's frame; ``usable (K,)`` bool marks those that may be matched.
    ``factors`` holds what is not matched here (dead reckoning), at the poses to start from. Those that
    ``fixed (K,)`` bool marks (default: none) stay where they are, and the others are matched to them alone.
    """
    from slam.graph.gauss_newton import settle

    cloud = _Cloud.of([Reference(scan, side=SIDE) for scan in scans])
    pairs = choose_pairs(factors.poses, usable, config, fixed)
    graph = factors
    for radius in config.radii:
        guesses = se2.between(*graph.poses[pairs.T])
        T_ij, information, used, misfit = cloud.linearise(pairs, guesses, radius, config)
        known = used >= config.least_pairs
        edges, T_ij = pairs[known], T_ij[known]
        information = se2.to_body_covariance(T_ij, information[known]) / config.match_inflation
        graph = replace(factors, poses=graph.poses).with_edges(edges, T_ij, information)
        graph = settle(graph, fixed, config.steps)
    doubt = discount_tilted(misfit[known], config)[:, None, None]
    graph = replace(factors, poses=graph.poses).with_edges(edges, T_ij, information / doubt)
    return settle(graph, fixed)


def discount_tilted(misfit: Array, config: BundleConfig) -> Array:
    """By what the information of scan pairs is divided, given their mean χ² ``misfit (P,)``."""
    return np.maximum(1.0, misfit / config.level_misfit) ** config.tilt_discount


@dataclass(frozen=True)
class _Cloud:
    """Scans packed for the kernel: scan k in rows ``offsets[k]:offsets[k + 1]``, with its lattice."""

    arrays: tuple[Array, ...]
    offsets: np.ndarray
    lattice: tuple[Any, ...]

    @classmethod
    def of(cls, scans: Sequence[Reference]) -> _Cloud:
        """That of scans whose lattices are all of one cell and side."""
        clouds, lattices = zip(*(scan.indexed for scan in scans), strict=True)
        cell, heads, following = zip(*lattices, strict=True)
        arrays = tuple(np.concatenate(parts) for parts in zip(*clouds, strict=True))
        offsets = np.concatenate([[0], np.cumsum([len(scan) for scan in scans])]).astype(np.int64)
        return cls(arrays, offsets, (cell[0], np.stack(heads), np.concatenate(following)))

    def linearise(self, pairs: np.ndarray, guesses: Array, radius: float, config: BundleConfig) -> Any:
        """One step of each pair ``(P, 2)`` from ``guesses (P, 3)``, as `slam.matching.kernels` has it."""
        from slam.matching.kernels import linearise_pairs

        return linearise_pairs(
            self.arrays, self.offsets, self.lattice, pairs, guesses, radius,
            config.robust, config.fade, config.length, config.same_side, config.freeze_ratio,
        )  # fmt: skip


def match_keyframe(
    references: Sequence[Reference],
    scan: Reference,
    guesses: Array,
    config: BundleConfig,
    limit: tuple[float, float],
) -> tuple[np.ndarray, Array, Array]:
    """A scan matched to each of P references from ``guesses (P, 3)`` of it seen from them.

    Returns which of them ``(P,)`` bool see enough of it and leave their guess by no more than ``limit`` (m,
    rad), and of these the poses ``T_ij (M, 3)`` and their information ``(M, 3, 3)`` in the scan's body.
    """
    cloud, count = _Cloud.of([*references, scan]), len(references)
    pairs = np.stack([np.arange(count), np.full(count, count)], axis=1)
    T_ij = guesses
    for radius in config.radii:
        T_ij, information, used, misfit = cloud.linearise(pairs, T_ij, radius, config)
    left = np.abs(se2.between(guesses, T_ij))
    known = (used >= config.least_pairs) & (np.hypot(left[:, 0], left[:, 1]) <= limit[0])
    known &= left[:, 2] <= limit[1]
    divisor = config.match_inflation * discount_tilted(misfit[known], config)
    in_body = se2.to_body_covariance(T_ij[known], information[known]) / divisor[:, None, None]
    return known, T_ij[known], in_body


def choose_pairs(
    poses: Array, usable: np.ndarray, config: BundleConfig, fixed: np.ndarray | None = None
) -> np.ndarray:
    """Pairs ``(P, 2)`` of keyframes i < j to match: near each other and from as many passes as there are;
    with some ``fixed``, these and the others."""
    first, second = (usable, usable) if fixed is None else (usable & fixed, usable & ~fixed)
    firsts = np.flatnonzero(first)
    tree = cKDTree(poses[firsts, :2])
    pairs = []
    for j in np.flatnonzero(second):
        near = firsts[np.sort(tree.query_ball_point(poses[j, :2], config.reach)).astype(np.int64)]
        pairs += [(int(i), int(j)) for i in choose_neighbours(poses, int(j), near, config)]
    return np.array(pairs, dtype=np.int64).reshape(-1, 2)


def partners(poses: Array, j: int, allowed: np.ndarray, config: BundleConfig) -> np.ndarray:
    """Earlier ones of ``poses (K, 3)`` to match keyframe j to: near it and from as many passes as there are,
    among those that ``allowed (K,)`` bool marks."""
    apart = np.linalg.norm(poses[:j, :2] - poses[j, :2], axis=1)
    return choose_neighbours(poses, j, np.flatnonzero((apart <= config.reach) & allowed[:j]), config)


def choose_neighbours(poses: Array, j: int, near: np.ndarray, config: BundleConfig) -> np.ndarray:
    """Those of the keyframes ``near`` j, in ascending order, that j is to be matched to: earlier ones, the
    latest passes first."""
    near = np.asarray(near, dtype=np.int64)
    near = near[near < j]
    apart = np.linalg.norm(poses[near, :2] - poses[j, :2], axis=1)
    passes = np.split(np.arange(len(near)), np.flatnonzero(np.diff(near) > 1) + 1)
    chosen, count = [np.zeros(0, dtype=np.int64)], 0
    for run in reversed(passes):
        if count >= config.neighbours or len(run) == 0:
            break
        chosen.append(_spread(run, apart, config.per_pass))
        count += len(chosen[-1])
    return near[np.concatenate(chosen)[: config.neighbours]]


def _spread(run: np.ndarray, apart: Array, most: int) -> np.ndarray:
    """At most ``most`` members of a run: the nearest, then evenly spaced ones."""
    if len(run) <= most:
        return run
    even = run[np.linspace(0, len(run) - 1, most).round().astype(int)]
    even[int(np.argmin(apart[even]))] = run[int(np.argmin(apart[run]))]
    return np.unique(even)
