"""The submap graph: submaps as nodes, the drive and stitches as edges, and what it knows of how two of them
lie."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Any, get_args

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra

from slam import se2
from slam.graph.pose_graph import GncConfig, Loss, PoseGraph, Solution, WorldSteps, informations, optimise
from slam.mapping.submap import Submap
from slam.recording import Source
from slam.se2 import Array
from stitch.align import NoStitch, Prior, Stitch
from stitch.alignment.config import AlignConfig, CovarianceConfig
from stitch.mapping.estimate import LoopCandidate

BACK_ENDS: tuple[Loss, ...] = get_args(Loss)
"""How the graph judges stitches: by graduated non-convexity, or not at all ("none" keeps every stitch)."""


@dataclass(frozen=True)
class LoopConfig:
    """How loop closures are sought.

    Raises ``ValueError`` for an unknown back end.
    """

    length: float = 3.0
    """Metres of drive that a submap spans."""
    reach: float = 4.0
    """Two submaps are candidates when their middles may lie within this [m] of each other."""
    candidates: int = 5
    """Earlier submaps that each is stitched to at most."""
    spread: int = 3
    """Submaps along the drive that two candidates are apart at least."""
    window: float = 0.8
    """Metres searched besides what the graph's covariance allows (three sigma), with wheel odometry."""
    window_ins: float = 0.4
    """The same with an INS."""
    window_angle: float = np.radians(5.0)
    """Angle [rad] searched besides what the graph's covariance allows (three sigma)."""
    inflation: float = 2.0
    """Inflation of the graph's covariance in a prior."""
    max_search: tuple[float, float] = (6.0, np.radians(60.0))
    """Three sigma (m, rad) of a prior beyond which all alignments are searched instead."""
    least_belief: float = 2.0
    """Log-odds by which a stitch that was found without a prior must be believed: look-alikes are many."""
    trusted_edge: float = 1.0
    """Metres that an accepted loop counts as graph distance."""
    broken_edge: float = 15.0
    """Metres that a failure adds to the graph distance."""
    rounds: int = 3
    """Rounds through the drive at most."""
    least_information: float = 2.5
    """A pair is tried only if a stitch is expected to tell this much [nats]."""
    stitch_sigmas: tuple[float, float, float] = (0.02, 0.025, np.radians(0.3))
    """Standard deviations (m, m, rad) that a stitch is expected to have: the median of those found."""
    retry_distance: float = 1.5
    """A refused pair is tried again when it is expected so many sigma of its prior elsewhere."""
    max_attempts: int = 2
    """How often a pair is tried at most."""
    max_residual: tuple[float, float, float] = (0.2, 0.2, np.radians(1.5))
    """A stitch that the finished bundle has further elsewhere (m, m, rad) does not count as accepted."""
    align: AlignConfig = field(
        default_factory=lambda: AlignConfig(covariance=CovarianceConfig(warp=(0.01, 0.0026)))
    )
    """How two submaps are aligned: those of a few metres bend less than its default says."""
    back_end: Loss = "gnc"
    """How the graph judges stitches, one of `BACK_ENDS`."""
    gnc: GncConfig = field(default_factory=GncConfig)
    """Graduated non-convexity."""

    def __post_init__(self) -> None:
        if self.back_end not in BACK_ENDS:
            raise ValueError(f"back_end: expected one of {', '.join(BACK_ENDS)}, got {self.back_end!r}")


class SubmapGraph:
    """Submaps, the alignments tried between them so far, and where the graph puts them now.

    ``odometry`` is the graph over the drive; ``nodes (K,)`` are its nodes that stand for the submaps'
    anchors, by default all. ``poses (L, 3)`` are those of all its nodes, ``weights`` how far each stitch is
    trusted, in the order of finding. A drive that goes on has its submaps added one by one.
    """

    def __init__(
        self,
        submaps: Sequence[Submap],
        odometry: PoseGraph,
        source: Source,
        config: LoopConfig,
        nodes: np.ndarray | None = None,
    ) -> None:
        self.submaps, self.config = submaps, config
        self.nodes = np.arange(len(submaps)) if nodes is None else nodes
        self.results: dict[tuple[int, int], Stitch | NoStitch] = {}
        self.poses: Array = odometry.poses
        self.weights: Array = np.zeros(0)
        window = config.window_ins if source == "ins" else config.window
        self._window_covariance = (np.diag([window, window, config.window_angle]) / 3.0) ** 2
        self._start_from(odometry)

    def _start_from(self, odometry: PoseGraph) -> None:
        """Take in the graph over the drive and the submaps as they are now."""
        self._odometry = self._graph = odometry
        broken = np.array([a.stop != b.start for a, b in pairwise(self.submaps)], dtype=float)
        walked = np.linalg.norm(np.diff(odometry.poses[self.nodes, :2], axis=0), axis=1)
        self._steps = walked + self.config.broken_edge * broken
        points = [submap.points.points for submap in self.submaps]
        self._middles = np.array([p.mean(axis=0) if len(p) else np.zeros(2) for p in points])
        self._forget()

    def _forget(self) -> None:
        """Forget what was computed before a submap came or a judgement changed."""
        self._inverse: tuple[Any, Array] | None = None  # factor of the graph and its blocks
        self._relative: dict[int, Array] = {}  # covariances by submap
        self._distances: dict[int, Array] = {}  # by submap

    def add(self, submap: Submap, step: PoseGraph | None) -> None:
        """The next submap of a drive whose graph has a node for each; ``step`` is a graph of the last submap
        and this one, None where this is the first."""
        last = len(self.submaps) - 1
        self.submaps = [*self.submaps, submap]
        self.nodes = np.arange(len(self.submaps))
        odometry = replace(self._odometry, poses=np.concatenate([self._odometry.poses, submap.anchor[None]]))
        if step is not None:
            odometry = odometry.with_edges(
                step.edges + last, step.T_ij, step.information, heavy_tailed=step.heavy_tailed
            )
            steps = (odometry.world_steps, replace(step.world_steps, edges=step.world_steps.edges + last))
            columns = zip(*(vars(part).values() for part in steps), strict=True)
            odometry = replace(odometry, world_steps=WorldSteps(*map(np.concatenate, columns)))
        self._start_from(odometry)

    @property
    def starts(self) -> list[int]:
        """The scan that each submap begins with."""
        return [submap.start for submap in self.submaps]

    @property
    def anchors(self) -> Array:
        """Poses ``(K, 3)`` of the submaps."""
        return self.poses[self.nodes]

    def stitches(self) -> list[tuple[tuple[int, int], Stitch]]:
        """Pairs that were stitched, in the order of trying, whatever the graph thinks of them."""
        return [(pair, r) for pair, r in self.results.items() if isinstance(r, Stitch)]

    def graph(self) -> PoseGraph:
        """The drive's graph with every stitch as a loop."""
        stitches = self.stitches()
        if new := stitches[int(self._graph.loop.sum()) :]:  # none is ever taken back
            self._graph = add_stitches(self._graph, new, self.nodes)
        return self._graph

    def optimise(self) -> None:
        """Place the submaps anew and judge the stitches."""
        graph = replace(self.graph(), poses=self.poses)
        solution = optimise_robustly(graph, self.config, self._all_weights())
        self.poses, self.weights = solution.poses, solution.weights
        self._forget()

    def trust_last(self) -> None:
        """Trust the stitch found last."""
        self.weights = np.append(self.weights, 1.0)
        self._forget()

    def trusted(self) -> dict[tuple[int, int], Stitch]:
        """The stitches the map rests on, once all were judged."""
        return {pair: r for (pair, r), w in zip(self.stitches(), self.weights, strict=True) if w > 0.5}

    def distances(self, b: int) -> Array:
        """Metres ``(K,)`` from submap b to every submap along the drive and over the loops that are
        trusted."""
        if b not in self._distances:
            k = len(self.submaps)
            lengths = dict(zip(pairwise(range(k)), np.maximum(self._steps, 1e-6).tolist(), strict=True))
            for (pair, _), weight in zip(self.stitches(), self.weights, strict=False):
                if weight > 0.5:
                    lengths[pair] = min(self.config.trusted_edge, lengths.get(pair, np.inf))
            rows, columns = np.array(list(lengths), dtype=np.int64).reshape(-1, 2).T
            edges = coo_array((list(lengths.values()), (rows, columns)), shape=(k, k))
            self._distances[b] = dijkstra(edges.tocsr(), directed=False, indices=b)
        return self._distances[b]

    def relative_covariances(self, b: int) -> Array:
        """Covariances ``(b, 3, 3)`` of submap b as seen from each earlier one, in b's tangent."""
        from slam.graph.gauss_newton import factor_of, relative_covariance

        if self._inverse is None:
            factor = factor_of(self.graph().with_only(self._all_weights() > 0.5), self.poses)
            self._inverse = (factor, factor.inverse_blocks())
        if b not in self._relative:
            factor, blocks = self._inverse
            seen_from, node = self.nodes[:b], int(self.nodes[b])
            self._relative[b] = relative_covariance(factor, blocks, self.poses, seen_from, node)
        return self._relative[b]

    def reach(self, b: int) -> Array:
        """How far off [m] submap b may lie as seen from each earlier one ``(b,)``: three sigma."""
        xx, xy, yy = self.relative_covariances(b)[:, [0, 0, 1], [0, 1, 1]].T
        return 3.0 * np.sqrt(0.5 * (xx + yy) + np.hypot(0.5 * (xx - yy), xy))

    def candidates(self, b: int) -> list[int]:
        """Earlier submaps worth trying: the one across a failure, then the nearest, spread along the
        drive."""
        config = self.config
        middles = se2.transform(self.anchors[: b + 1], self._middles[: b + 1, None])[:, 0]
        apart = np.linalg.norm(middles[:b] - middles[b], axis=1)
        near = apart <= config.reach + self.reach(b)
        chosen = [b - 1] if self.submaps[b - 1].stop != self.submaps[b].start else []
        for a in np.flatnonzero(near)[np.argsort(apart[near], kind="stable")]:
            if len(chosen) >= config.candidates:
                break
            if a != b - 1 and all(abs(a - other) >= config.spread for other in chosen):
                chosen.append(int(a))
        return [a for a in chosen if (a, b) not in self.results]

    def prior(self, a: int, b: int) -> Prior:
        """Where the graph expects b seen from a; the search window is its three sigma."""
        covariance = self.config.inflation * self.relative_covariances(b)[a] + self._window_covariance
        return Prior(se2.between(self.anchors[a], self.anchors[b]), (covariance + covariance.T) / 2.0)

    def search_prior(self, a: int, b: int) -> Prior | None:
        """The prior to search around; None where it leaves so much open that a search of everything is as
        good."""
        prior = self.prior(a, b)
        shift, turn = self.config.max_search
        away = 3.0 * np.sqrt(np.linalg.eigvalsh(prior.covariance[:2, :2])[-1])
        return prior if away <= shift and 9.0 * prior.covariance[2, 2] <= turn**2 else None

    def expected_information(self, a: int, b: int) -> float:
        """What a stitch of two submaps is expected to tell [nats] (Ila et al. 2010)."""
        information = np.diag(np.square(self.config.stitch_sigmas) ** -1.0)
        gain = self.relative_covariances(b)[a] @ information
        return 0.5 * float(np.linalg.slogdet(np.eye(3) + gain)[1])

    def _all_weights(self) -> Array:
        """Weights of all stitches; one that was not judged yet is trusted."""
        return np.concatenate([self.weights, np.ones(len(self.stitches()) - len(self.weights))])


def optimise_robustly(graph: PoseGraph, config: LoopConfig, weights: Array | None = None) -> Solution:
    """Poses of the graph and weights of its loops, as ``config.back_end`` judges them.

    ``weights (L,)``: those the loops had until now, from which graduated non-convexity may start.
    """
    from slam.graph.gauss_newton import solve_gnc

    if config.back_end == "gnc" or not np.any(graph.loop):
        return solve_gnc(graph, weights, config.gnc)
    return optimise(graph, "none")


def add_stitches(
    graph: PoseGraph, stitches: Sequence[tuple[tuple[int, int], Stitch]], nodes: np.ndarray | None = None
) -> PoseGraph:
    """The graph with stitches between submaps as loops; ``nodes (K,)`` stand for these, by default 0 to K-1.

    Raises ``ValueError`` naming the pair whose covariance is not positive definite.
    """
    pairs = np.array([pair for pair, _ in stitches], dtype=np.int64).reshape(-1, 2)
    T_ab = np.array([stitch.T_a_b for _, stitch in stitches]).reshape(-1, 3)
    covariance = np.array([stitch.covariance for _, stitch in stitches], dtype=np.float64)
    information = informations(pairs, covariance)
    return graph.with_loops(pairs if nodes is None else nodes[pairs], T_ab, information)


def with_weights(candidates: Sequence[LoopCandidate], weights: Array) -> tuple[LoopCandidate, ...]:
    """Loop candidates with the graph's ``weights (L,)`` of those that got there, in their order."""
    left = iter(weights)
    return tuple(
        replace(c, weight=float(next(left))) if isinstance(c.result, Stitch) else c for c in candidates
    )
