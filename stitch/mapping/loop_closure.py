"""Closing loops in the order of the drive: which submaps may overlap, stitch them, let the graph judge."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Literal

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra

from slam import se2
from slam.graph.cholesky import Factor
from slam.graph.consistency import consistent_loops
from slam.graph.gauss_newton import Problem
from slam.graph.gnc import judge
from slam.graph.marginals import relative_covariance
from slam.graph.pose_graph import Loss, PoseGraph, Solution, informations, optimise
from slam.mapping.submap import Submap
from slam.se2 import Array
from stitch.align import NoStitch, Prior, Stitch
from stitch.alignment.config import AlignConfig, CovarianceConfig
from stitch.alignment.result import Alternative
from stitch.mapping.estimate import LoopCandidate

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

Stitcher = Callable[..., Stitch | NoStitch]
"""Answers for two submaps and a `Prior`, or None where nothing is known of how they lie."""

Redraw = Callable[[Array, Sequence[Submap]], Sequence[Submap]]
"""The submaps as poses of the graph's nodes would have them: those whose shape changed are drawn anew, the
others are the same objects."""

STITCH_SIGMAS = (0.02, 0.025, np.radians(0.3))
"""Standard deviations (m, m, rad) of a stitch, about: the median of those found."""

MOVED = 1.5
"""A refused pair is tried again when it is expected so many standard deviations of its prior elsewhere."""

ATTEMPTS = 2
"""How often a pair is tried at most."""


@dataclass(frozen=True)
class LoopConfig:
    """How loops are sought.

    A submap spans ``length`` m of drive. Each is stitched to at most ``candidates`` earlier ones whose
    middles may lie within ``reach`` m, no two of them closer than ``spread`` submaps along the drive. What
    the graph knows of how two submaps lie, its covariance ``inflation``-fold, and ``window`` (for an INS
    ``window_ins``) m and ``window_angle`` rad on top make three sigma that are searched; beyond ``usable``
    (m, rad) the search is of all alignments, and what it finds must be believed by ``least_belief`` log-odds.
    A pair is tried only if a stitch is expected to tell ``least_information`` nats: one that the graph knows
    by others needs none, however often its place is seen. All in at most ``rounds`` rounds. Graph distance,
    where it is asked for: an accepted loop counts ``trusted_edge`` m, a failure adds ``broken_edge`` m.
    ``align``: submaps of a few metres bend less than its default says. ``back_end`` judges the stitches.
    For ablation: of all stitches a share of ``injected`` is made up, drawn with ``injected_seed``.
    """

    length: float = 3.0
    reach: float = 4.0
    candidates: int = 5
    spread: int = 3
    window: float = 0.8
    window_ins: float = 0.4
    window_angle: float = np.radians(5.0)
    inflation: float = 2.0
    usable: tuple[float, float] = (6.0, np.radians(60.0))
    least_belief: float = 2.0
    trusted_edge: float = 1.0
    broken_edge: float = 15.0
    rounds: int = 3
    least_information: float = 2.5
    align: AlignConfig = field(
        default_factory=lambda: AlignConfig(covariance=CovarianceConfig(warp=(0.01, 0.0026)))
    )
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
    """The graph with its loops, the poses and weights it settled on, and every stitch tried.

    ``nodes (K,)`` are the graph's nodes that stand for the ``submaps``, None where node k is submap k; these
    are as they were drawn last.
    """

    graph: PoseGraph
    poses: Array
    tried: tuple[LoopCandidate, ...]
    submaps: tuple[Submap, ...] = ()
    nodes: np.ndarray | None = None


class Search:
    """The submaps, the stitches tried between them so far, and where the graph puts them now.

    ``nodes (K,)`` are the graph's nodes that stand for the submaps' anchors.
    """

    def __init__(
        self,
        submaps: Sequence[Submap],
        backbone: PoseGraph,
        source: str,
        config: LoopConfig,
        nodes: np.ndarray | None = None,
    ) -> None:
        self.submaps, self.config = submaps, config
        self.nodes = np.arange(len(submaps)) if nodes is None else nodes
        window = config.window_ins if source == "ins" else config.window
        self.least = np.diag([window, window, config.window_angle]) / 3.0
        self.results: dict[tuple[int, int], Stitch | NoStitch] = {}
        self.tried: list[LoopCandidate] = []
        self.poses = backbone.poses
        self.weights: Array = np.zeros(0)
        broken = np.array([a.stop != b.start for a, b in pairwise(submaps)], dtype=float)
        walked = np.linalg.norm(np.diff(backbone.poses[self.nodes, :2], axis=0), axis=1)
        self.steps = walked + config.broken_edge * broken
        self.middles = np.array([_middle(submap) for submap in submaps])
        self._graph = backbone
        self._known: tuple[Factor, Array] | None = None  # the graph's, until it settles anew
        self._seen: dict[int, Array] = {}  # covariances by submap, as long

    @property
    def anchors(self) -> Array:
        """Poses ``(K, 3)`` of the submaps."""
        return self.poses[self.nodes]

    def accepted(self) -> list[tuple[tuple[int, int], Stitch]]:
        """Pairs that were stitched, in the order of trying, whatever the graph thinks of them."""
        return [(pair, r) for pair, r in self.results.items() if isinstance(r, Stitch)]

    def distances(self, b: int) -> Array:
        """Metres ``(K,)`` from submap b to every submap along the drive and over the loops that are
        trusted."""
        k = len(self.submaps)
        lengths = dict(zip(pairwise(range(k)), np.maximum(self.steps, 1e-6).tolist(), strict=True))
        for (pair, _), weight in zip(self.accepted(), self.weights, strict=False):
            if weight > 0.5:
                lengths[pair] = min(self.config.trusted_edge, lengths.get(pair, np.inf))
        rows, columns = zip(*lengths, strict=True)
        edges = coo_array((list(lengths.values()), (rows, columns)), shape=(k, k))
        return dijkstra(edges.tocsr(), directed=False, indices=b)

    def covariances(self, b: int) -> Array:
        """Covariances ``(b, 3, 3)`` of submap b as seen from each earlier one, in b's tangent."""
        if self._known is None:
            trusted = self.graph().with_only(self._all_weights() > 0.5)
            factor, _ = Problem.of(trusted).factor(self.poses, np.ones(len(trusted.edges)))
            self._known, self._seen = (factor, factor.inverse_blocks()), {}
        if b not in self._seen:
            seen = relative_covariance(*self._known, self.poses, self.nodes[:b], int(self.nodes[b]))
            self._seen[b] = seen
        return self._seen[b]

    def candidates(self, b: int) -> list[int]:
        """Earlier submaps worth trying: the one across a failure, then the nearest, spread along the
        drive."""
        middles = se2.transform(self.anchors[: b + 1], self.middles[: b + 1, None])[:, 0]
        apart = np.linalg.norm(middles[:b] - middles[b], axis=1)
        near = apart <= self.config.reach + self.doubt(b)
        chosen = [b - 1] if self.submaps[b - 1].stop != self.submaps[b].start else []
        for a in np.flatnonzero(near)[np.argsort(apart[near], kind="stable")]:
            if len(chosen) >= self.config.candidates:
                break
            if a != b - 1 and all(abs(a - other) >= self.config.spread for other in chosen):
                chosen.append(int(a))
        return [a for a in chosen if (a, b) not in self.results]

    def doubt(self, b: int) -> Array:
        """How far off [m] submap b may lie as seen from each earlier one ``(b,)``: three sigma."""
        xx, xy, yy = self.covariances(b)[:, [0, 0, 1], [0, 1, 1]].T
        return 3.0 * np.sqrt(0.5 * (xx + yy) + np.hypot(0.5 * (xx - yy), xy))

    def prior(self, a: int, b: int) -> Prior:
        """Where the graph expects b seen from a; the search window is its three sigma."""
        covariance = self.config.inflation * self.covariances(b)[a] + self.least**2
        return Prior(se2.between(self.anchors[a], self.anchors[b]), (covariance + covariance.T) / 2.0)

    def information(self, a: int, b: int) -> float:
        """What a stitch of two submaps is expected to tell [nats] (Ila et al. 2010)."""
        told = self.covariances(b)[a] @ np.diag(np.square(STITCH_SIGMAS) ** -1.0)
        return 0.5 * float(np.linalg.slogdet(np.eye(3) + told)[1])

    def usable(self, prior: Prior) -> bool:
        """False where a prior leaves so much open that a search of everything is as good."""
        away = 3.0 * np.sqrt(np.linalg.eigvalsh(prior.covariance[:2, :2])[-1])
        return bool(
            away <= self.config.usable[0] and 9.0 * prior.covariance[2, 2] <= self.config.usable[1] ** 2
        )

    def visit(self, b: int, stitch: Stitcher, turn: int) -> None:
        """Stitch submap b to its candidates in round ``turn`` as long as they tell something; where that
        succeeds, let the graph settle."""
        for a, expected in [(a, self.prior(a, b)) for a in self.candidates(b)]:
            if self.information(a, b) < self.config.least_information:
                continue
            prior = expected if self.usable(expected) else None
            result = doubted(stitch(self.submaps[a], self.submaps[b], prior), prior, self.config)
            self.results[a, b] = result
            self.tried.append(LoopCandidate(a, b, result, turn=turn, prior=prior))
            if isinstance(result, Stitch):
                self.settle()

    def reopen(self, redrawn: set[int]) -> None:
        """Allow refused pairs to be tried again of which a submap was ``redrawn``, or which are expected
        elsewhere by now."""
        last = {(one.a, one.b): one for one in self.tried}
        times = Counter((one.a, one.b) for one in self.tried)
        for (a, b), one in last.items():
            if isinstance(one.result, Stitch) or times[a, b] >= ATTEMPTS:
                continue
            here = se2.between(self.anchors[a], self.anchors[b])
            moved = one.prior is not None and one.prior.distance(here) > MOVED**2
            if moved or a in redrawn or b in redrawn:
                self.results.pop((a, b), None)

    def redraw(self, redraw: Redraw | None) -> None:
        """Let submaps be drawn as the graph now has them, and reopen the pairs that this may decide."""
        drawn = self.submaps if redraw is None else redraw(self.poses, self.submaps)
        redrawn = {k for k, (old, new) in enumerate(zip(self.submaps, drawn, strict=True)) if new is not old}
        self.submaps = drawn
        self.reopen(redrawn)

    def graph(self) -> PoseGraph:
        """The backbone with every accepted stitch as a loop."""
        accepted = self.accepted()
        if new := accepted[int(self._graph.loop.sum()) :]:  # none is ever taken back
            self._graph = with_stitches(self._graph, new, self.nodes)
        return self._graph

    def settle(self) -> None:
        """Let the robust graph place the submaps and judge the stitches."""
        graph = replace(self.graph(), poses=self.poses)
        solution = settled(graph, self.config.back_end, self._all_weights())
        self.poses, self.weights, self._known = solution.poses, solution.weights, None

    def _all_weights(self) -> Array:
        """Weights of all stitches; one that was not judged yet is trusted."""
        return np.concatenate([self.weights, np.ones(len(self.accepted()) - len(self.weights))])


def doubted(result: Stitch | NoStitch, prior: Prior | None, config: LoopConfig) -> Stitch | NoStitch:
    """A result; one found without a prior only if it is believed enough, as look-alikes are many."""
    if prior is not None or isinstance(result, NoStitch) or result.belief is None:
        return result
    if result.belief >= config.least_belief:
        return result
    return NoStitch(
        f"belief {result.belief:.3g} in a search of everything, expected at least {config.least_belief:.3g}",
        Alternative(result.T_a_b, result.score),
    )


def _middle(submap: Submap) -> Array:
    """Middle ``(2,)`` of a submap's points; its anchor where it has none."""
    points = submap.points.points
    return points.mean(axis=0) if len(points) else np.zeros(2)


def with_stitches(
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


def settled(graph: PoseGraph, back_end: BackEnd, known: Array | None = None) -> Solution:
    """Poses of the graph and weights of its loops, as a back end judges them.

    ``known (L,)``: weights the loops had until now, from which graduated non-convexity may start.
    """
    first_consistent, loss = BACK_ENDS[back_end]
    if back_end == "gnc" or not np.any(graph.loop):
        return judge(graph, known)
    if not first_consistent:
        return optimise(graph, loss)
    kept = consistent_loops(graph)
    solution = judge(graph.with_only(kept)) if loss == "gnc" else optimise(graph.with_only(kept), loss)
    weights: Array = np.zeros(len(kept))
    weights[kept] = solution.weights
    return Solution(solution.poses, weights)


def close(
    submaps: Sequence[Submap],
    backbone: PoseGraph,
    source: str,
    config: LoopConfig,
    stitch: Stitcher,
    nodes: np.ndarray | None = None,
    redraw: Redraw | None = None,
) -> Closed:
    """Stitch submaps to earlier ones in the order of the drive, re-optimising whenever a stitch was
    found.

    ``backbone`` is the graph over the submaps' anchors, which are its ``nodes (K,)``, by default all;
    ``source`` tells an INS from odometry; ``stitch`` answers for a pair and where the graph expects it;
    ``redraw`` draws submaps anew between rounds. Ends when a round finds no pair to try.
    """
    search = Search(submaps, backbone, source, config, nodes)
    search.settle()  # dead reckoning and matches have their say even where nothing is ever stitched
    for turn in range(config.rounds):
        if turn > 0:
            search.redraw(redraw)
        asked = len(search.tried)
        for b in range(1, len(submaps)):
            search.visit(b, stitch, turn)
        if len(search.tried) == asked:
            break
    solution = settled(replace(search.graph(), poses=search.poses), config.back_end)
    believed = replace(search.graph().with_only(solution.weights > 0.5), poses=solution.poses)
    poses = optimise(believed, "none").poses  # the last word is gtsam's
    tried = weighed(tuple(search.tried), solution.weights)
    return Closed(search.graph(), poses, tried, tuple(search.submaps), nodes)


def weighed(tried: tuple[LoopCandidate, ...], weights: Array) -> tuple[LoopCandidate, ...]:
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
    poses = closed.poses if closed.nodes is None else closed.poses[closed.nodes]
    false = [false_stitch(poses, found, rng) for _ in range(count)]
    graph = with_stitches(closed.graph, false, closed.nodes)
    solution = settled(replace(graph, poses=start), config.back_end)
    tried = (*closed.tried, *(LoopCandidate(a, b, stitch) for (a, b), stitch in false))
    return replace(closed, graph=graph, poses=solution.poses, tried=weighed(tried, solution.weights))


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
