"""Closing loops in the order of the drive: which submaps may overlap, stitch them, let the graph judge."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Literal

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra

from scenarios.estimate import TriedStitch
from slam import se2
from slam.consistency import consistent_loops
from slam.posegraph import Loss, PoseGraph, Solution, informations, optimise
from slam.se2 import Array
from slam.submap import Submap
from stitch.align import NoStitch, Prior, Stitch
from stitch.config import AlignConfig

BackEnd = Literal["gnc", "dcs", "none", "pcm", "pcm_gnc"]
BACK_ENDS: dict[BackEnd, tuple[bool, Loss]] = {
    "gnc": (False, "gnc"),
    "dcs": (False, "dcs"),
    "none": (False, "none"),
    "pcm": (True, "none"),
    "pcm_gnc": (True, "gnc"),
}
"""How the graph judges stitches: whether the largest consistent set is taken first, and the loss of the rest.

"none" keeps every stitch.
"""

INJECTED_OFFSET = (1.0, 5.0)
"""A false stitch that is injected lies this far [m] from where the graph has its submap, turned by any
angle."""

Stitcher = Callable[[Submap, Submap, Prior], Stitch | NoStitch]


@dataclass(frozen=True)
class LoopConfig:
    """How loops are sought.

    A submap spans ``length`` m of drive. Each is stitched to at most ``candidates`` earlier ones whose
    middles may lie within ``reach`` m, no two of them closer than ``spread`` submaps along the drive. The
    search window grows with the graph distance: ``window`` (m at distance zero, m per m, most m),
    ``window_ins`` for an INS, and ``window_angle`` likewise in rad. ``trusted_edge`` m is how long an
    accepted loop counts in that distance, ``broken_edge`` m what a failure adds to it. ``back_end`` judges
    the stitches. For ablation: of all stitches a share of ``injected`` is made up, drawn with
    ``injected_seed``.
    """

    length: float = 3.0
    reach: float = 4.0
    candidates: int = 5
    spread: int = 3
    window: tuple[float, float, float] = (0.8, 0.020, 3.5)
    window_ins: tuple[float, float, float] = (0.4, 0.008, 1.0)
    window_angle: tuple[float, float, float] = (np.radians(5.0), np.radians(0.25), np.radians(20.0))
    trusted_edge: float = 1.0
    broken_edge: float = 15.0
    rounds: int = 2
    align: AlignConfig = field(default_factory=AlignConfig)
    back_end: BackEnd = "gnc"
    injected: float = 0.0
    injected_seed: int = 0

    def __post_init__(self) -> None:
        if self.back_end not in BACK_ENDS:
            raise ValueError(f"back_end: expected one of {', '.join(BACK_ENDS)}, got {self.back_end!r}")
        if not 0.0 <= self.injected < 1.0:
            raise ValueError(f"injected: expected a share of at least 0 and below 1, got {self.injected}")


@dataclass(frozen=True)
class Closed:
    """The graph over submap anchors with its loops, the poses and weights it settled on, and every stitch
    tried."""

    graph: PoseGraph
    poses: Array
    tried: tuple[TriedStitch, ...]


class _Search:
    """The submaps, the stitches tried between them so far, and where the graph puts them now."""

    def __init__(self, submaps: list[Submap], backbone: PoseGraph, source: str, config: LoopConfig) -> None:
        self.submaps, self.backbone, self.config = submaps, backbone, config
        self.window = config.window_ins if source == "ins" else config.window
        self.results: dict[tuple[int, int], Stitch | NoStitch] = {}
        self.poses = backbone.poses
        self.weights: Array = np.zeros(0)
        broken = np.array([a.stop != b.start for a, b in pairwise(submaps)], dtype=float)
        walked = np.linalg.norm(np.diff(backbone.poses[:, :2], axis=0), axis=1)
        self.steps = walked + config.broken_edge * broken
        self.middles = np.array([_middle(submap) for submap in submaps])

    def accepted(self) -> list[tuple[tuple[int, int], Stitch]]:
        """Pairs that were stitched, in the order of trying, whatever the graph thinks of them."""
        return [(pair, r) for pair, r in self.results.items() if isinstance(r, Stitch)]

    def distances(self, b: int) -> Array:
        """Metres ``(K,)`` from node b to every node along the drive and over the loops that are trusted."""
        k = len(self.submaps)
        lengths = dict(zip(pairwise(range(k)), np.maximum(self.steps, 1e-6).tolist(), strict=True))
        for (pair, _), weight in zip(self.accepted(), self.weights, strict=False):
            if weight > 0.5:
                lengths[pair] = min(self.config.trusted_edge, lengths.get(pair, np.inf))
        rows, columns = zip(*lengths, strict=True)
        edges = coo_array((list(lengths.values()), (rows, columns)), shape=(k, k))
        return dijkstra(edges.tocsr(), directed=False, indices=b)

    def reach(self, distance: Array | float) -> Array:
        """Half width [m] of the search at a graph distance [m]."""
        base, slope, most = self.window
        return np.minimum(base + slope * np.asarray(distance), most)

    def candidates(self, b: int) -> list[int]:
        """Earlier submaps worth trying: the one across a failure, then the nearest, spread along the
        drive."""
        middles = se2.transform(self.poses[: b + 1], self.middles[: b + 1, None])[:, 0]
        apart = np.linalg.norm(middles[:b] - middles[b], axis=1)
        near = apart <= self.config.reach + self.reach(self.distances(b)[:b])
        chosen = [b - 1] if self.submaps[b - 1].stop != self.submaps[b].start else []
        for a in np.argsort(apart, kind="stable"):
            if len(chosen) >= self.config.candidates:
                break
            if near[a] and a != b - 1 and all(abs(a - other) >= self.config.spread for other in chosen):
                chosen.append(int(a))
        return [a for a in chosen if (a, b) not in self.results]

    def prior(self, a: int, b: int) -> Prior:
        """Where the graph expects b seen from a; the search window is its three sigma."""
        distance = float(self.distances(b)[a])
        base, slope, most = self.config.window_angle
        sigma, sigma_angle = float(self.reach(distance)) / 3.0, min(base + slope * distance, most) / 3.0
        return Prior(se2.between(self.poses[a], self.poses[b]), np.diag([sigma, sigma, sigma_angle]) ** 2)

    def graph(self) -> PoseGraph:
        """The backbone with every accepted stitch as a loop."""
        return with_stitches(self.backbone, self.accepted())

    def settle(self) -> None:
        """Let the robust graph place the submaps and judge the stitches."""
        solution = settled(replace(self.graph(), poses=self.poses), self.config.back_end)
        self.poses, self.weights = solution.poses, solution.weights


def _middle(submap: Submap) -> Array:
    """Middle ``(2,)`` of a submap's points; its anchor where it has none."""
    points = submap.points.points
    return points.mean(axis=0) if len(points) else np.zeros(2)


def with_stitches(graph: PoseGraph, stitches: Sequence[tuple[tuple[int, int], Stitch]]) -> PoseGraph:
    """The graph with stitches between its nodes as further loops.

    Raises ``ValueError`` naming the pair whose covariance is not positive definite.
    """
    pairs = np.array([pair for pair, _ in stitches], dtype=np.int64).reshape(-1, 2)
    T_ab = np.array([stitch.T_a_b for _, stitch in stitches]).reshape(-1, 3)
    covariance = np.array([stitch.covariance for _, stitch in stitches], dtype=np.float64)
    return graph.with_loops(pairs, T_ab, informations(pairs, covariance))


def settled(graph: PoseGraph, back_end: BackEnd) -> Solution:
    """Poses of the graph and weights of its loops, as a back end judges them."""
    first_consistent, loss = BACK_ENDS[back_end]
    if not first_consistent or not np.any(graph.loop):
        return optimise(graph, loss)
    kept = consistent_loops(graph)
    solution = optimise(graph.with_only(kept), loss)
    weights: Array = np.zeros(len(kept))
    weights[kept] = solution.weights
    return Solution(solution.poses, weights)


def close(
    submaps: list[Submap], backbone: PoseGraph, source: str, config: LoopConfig, stitch: Stitcher
) -> Closed:
    """Stitch submaps to earlier ones in the order of the drive, re-optimising whenever a stitch was
    found.

    ``backbone`` is the graph over the submaps' anchors, node k = submap k; ``source`` tells an INS from
    odometry; ``stitch`` answers for a pair and where the graph expects it.
    """
    search = _Search(submaps, backbone, source, config)
    search.settle()  # dead reckoning and matches have their say even where nothing is ever stitched
    for _ in range(config.rounds):
        asked = len(search.results)
        for b in range(1, len(submaps)):
            tried = {(a, b): stitch(submaps[a], submaps[b], search.prior(a, b)) for a in search.candidates(b)}
            search.results.update(tried)
            if any(isinstance(result, Stitch) for result in tried.values()):
                search.settle()
        if len(search.results) == asked:
            break
    tried_stitches = tuple(TriedStitch(a, b, result) for (a, b), result in search.results.items())
    return Closed(search.graph(), search.poses, weighed(tried_stitches, search.weights))


def weighed(tried: tuple[TriedStitch, ...], weights: Array) -> tuple[TriedStitch, ...]:
    """Tried stitches with the graph's ``weights (L,)`` of those that got there, in their order."""
    left = iter(weights)
    return tuple(
        replace(one, weight=float(next(left))) if isinstance(one.result, Stitch) else one for one in tried
    )


def with_false(closed: Closed, start: Array, config: LoopConfig, rng: np.random.Generator) -> Closed:
    """The loops with so many false ones among them that these are a share of ``config.injected``, judged
    anew from the poses ``start (K, 3)``. Without any stitch nothing is injected.
    """
    found = [one.result for one in closed.tried if isinstance(one.result, Stitch)]
    if not found:
        return closed
    count = round(len(found) * config.injected / (1.0 - config.injected))
    false = [false_stitch(closed.poses, found, rng) for _ in range(count)]
    graph = with_stitches(closed.graph, false)
    solution = settled(replace(graph, poses=start), config.back_end)
    tried = (*closed.tried, *(TriedStitch(a, b, stitch) for (a, b), stitch in false))
    return Closed(graph, solution.poses, weighed(tried, solution.weights))


def false_stitch(
    poses: Array, found: Sequence[Stitch], rng: np.random.Generator
) -> tuple[tuple[int, int], Stitch]:
    """A stitch of two nodes drawn by chance, off by `INJECTED_OFFSET` from where ``poses (K, 3)`` have them.

    It claims the covariance of one of the stitches ``found``.
    """
    a, b = sorted(rng.choice(len(poses), 2, replace=False).tolist())
    distance, (bearing, yaw) = rng.uniform(*INJECTED_OFFSET), rng.uniform(-np.pi, np.pi, 2)
    offset = np.array([distance * np.cos(bearing), distance * np.sin(bearing), yaw])
    T_a_b = se2.compose(se2.between(poses[a], poses[b]), offset)
    return (a, b), replace(found[int(rng.integers(len(found)))], T_a_b=T_a_b)
