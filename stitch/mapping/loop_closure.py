"""Loop closure in the order of the drive: choose candidates, stitch them, let the graph judge."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from slam import se2
from slam.graph.pose_graph import PoseGraph, optimise
from slam.mapping.submap import Submap
from slam.se2 import Array
from stitch.align import NoStitch, Prior, Stitch
from stitch.alignment.result import Alternative
from stitch.mapping.estimate import LoopCandidate
from stitch.mapping.submap_graph import SubmapGraph, optimise_robustly, with_weights

Stitcher = Callable[..., Stitch | NoStitch]
"""Answers for two submaps and a `Prior`, or None where nothing is known of how they lie."""

Redraw = Callable[[Array, Sequence[Submap]], Sequence[Submap]]
"""The submaps as poses of the graph's nodes would have them: those whose shape changed are drawn anew, the
others are the same objects."""


@dataclass(frozen=True)
class LoopClosureResult:
    """The graph with its loops, the poses and weights it settled on, and every candidate tried.

    ``nodes (K,)`` are the graph's nodes that stand for the ``submaps``, None where node k is submap k; these
    are as they were drawn last.
    """

    graph: PoseGraph
    poses: Array
    tried: tuple[LoopCandidate, ...]
    submaps: tuple[Submap, ...] = ()
    nodes: np.ndarray | None = None


class LoopCloser:
    """Tries the loop closures of a submap graph; ``stitch`` answers for a pair and where it is expected."""

    def __init__(self, submap_graph: SubmapGraph, stitch: Stitcher) -> None:
        self.submap_graph, self.stitch = submap_graph, stitch
        self.config = submap_graph.config
        self.tried: list[LoopCandidate] = []

    def close_loops(self, b: int, round: int) -> None:
        """Stitch submap b to its candidates as long as they tell something; where that succeeds, let the
        graph settle."""
        graph = self.submap_graph
        expected = [(a, graph.search_prior(a, b)) for a in graph.candidates(b)]
        for a, prior in expected:
            if graph.expected_information(a, b) < self.config.least_information:
                continue
            result = self.stitch(graph.submaps[a], graph.submaps[b], prior)
            result = gate_by_belief(result, prior, self.config.least_belief)
            graph.results[a, b] = result
            self.tried.append(LoopCandidate(a, b, result, round=round, prior=prior))
            if isinstance(result, Stitch):
                graph.optimise()

    def redraw(self, redraw: Redraw | None) -> None:
        """Let submaps be drawn as the graph now has them, and refused pairs be tried again of which a submap
        was redrawn, or which are expected elsewhere by now."""
        graph = self.submap_graph
        drawn = graph.submaps if redraw is None else redraw(graph.poses, graph.submaps)
        redrawn = {k for k, (old, new) in enumerate(zip(graph.submaps, drawn, strict=True)) if new is not old}
        graph.submaps = drawn
        last = {(c.a, c.b): c for c in self.tried}
        attempts = Counter((c.a, c.b) for c in self.tried)
        for (a, b), candidate in last.items():
            if isinstance(candidate.result, Stitch) or attempts[a, b] >= self.config.max_attempts:
                continue
            here = se2.between(graph.anchors[a], graph.anchors[b])
            prior = candidate.prior
            moved = prior is not None and prior.distance(here) > self.config.retry_distance**2
            if moved or a in redrawn or b in redrawn:
                graph.results.pop((a, b), None)


def close_loops(
    submap_graph: SubmapGraph, stitch: Stitcher, redraw: Redraw | None = None
) -> LoopClosureResult:
    """Stitch submaps to earlier ones in the order of the drive, re-optimising whenever a stitch was found.

    ``redraw`` draws submaps anew between rounds. Ends when a round finds no pair to try.
    """
    config, closer = submap_graph.config, LoopCloser(submap_graph, stitch)
    submap_graph.optimise()  # dead reckoning and matches have their say even where nothing is ever stitched
    for round in range(config.rounds):
        if round > 0:
            closer.redraw(redraw)
        before = len(closer.tried)
        for b in range(1, len(submap_graph.submaps)):
            closer.close_loops(b, round)
        if len(closer.tried) == before:
            break
    graph = submap_graph.graph()
    solution = optimise_robustly(replace(graph, poses=submap_graph.poses), config)
    believed = replace(graph.with_only(solution.weights > 0.5), poses=solution.poses)
    poses = optimise(believed, "none").poses  # gtsam has the last word
    tried = with_weights(closer.tried, solution.weights)
    return LoopClosureResult(graph, poses, tried, tuple(submap_graph.submaps), submap_graph.nodes)


def gate_by_belief(result: Stitch | NoStitch, prior: Prior | None, least_belief: float) -> Stitch | NoStitch:
    """A result; one found without a prior only if it is believed enough, as look-alikes are many."""
    if prior is not None or isinstance(result, NoStitch) or result.belief is None:
        return result
    if result.belief >= least_belief:
        return result
    return NoStitch(
        f"belief {result.belief:.3g} in a search of everything, expected at least {least_belief:.3g}",
        Alternative(result.T_a_b, result.score),
    )


def reject_inconsistent_loops(
    tried: Sequence[LoopCandidate], anchors: Array, max_residual: tuple[float, float, float]
) -> tuple[LoopCandidate, ...]:
    """Loop candidates, those switched off that the bundle refutes: it knows the scans of both submaps one by
    one, and has their ``anchors (S, 3)`` further than ``max_residual`` (m, m, rad) from the stitch."""
    checked = []
    for candidate in tried:
        if isinstance(candidate.result, Stitch):
            expected = se2.between(anchors[candidate.a], anchors[candidate.b])
            residual = np.abs(se2.between(candidate.result.T_a_b, expected))
            if np.any(residual > max_residual):
                candidate = replace(candidate, weight=0.0)
        checked.append(candidate)
    return tuple(checked)
