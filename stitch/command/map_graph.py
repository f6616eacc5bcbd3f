"""Any number of maps: every pair stitched, the stitches judged together in a pose graph."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import breadth_first_order, connected_components

from slam import se2
from slam.graph.marginals import marginals
from slam.graph.pose_graph import PoseGraph, optimise
from slam.se2 import Array
from stitch.alignment.result import NoStitch, Stitch

Pair = tuple[int, int]
KEPT = 0.5
"""Weight above which graduated non-convexity has kept a stitch."""


@dataclass(frozen=True)
class Network:
    """Maps joined to the first one.

    ``members`` are the indices of the maps joined, the first of all maps first; ``poses (M, 3)`` theirs in
    its frame, ``covariances (M, 3, 3)``; ``results`` of all pairs tried; ``trusted`` the pairs whose
    stitches hold it together.
    """

    members: tuple[int, ...]
    poses: Array
    covariances: Array
    results: dict[Pair, Stitch | NoStitch]
    trusted: frozenset[Pair]


def join(count: int, stitch: Callable[[int, int], Stitch | NoStitch]) -> Network:
    """Stitch every pair of ``count`` maps and join those that hang together with the first.

    Stitches that contradict the others are switched off (graduated non-convexity, Yang et al. 2020). Where a
    contradiction leaves one chain of stitches against one stitch, nobody can tell which of them is false, and
    none is trusted.
    """
    results = {pair: stitch(*pair) for pair in combinations(range(count), 2)}
    edges = {pair: result for pair, result in results.items() if isinstance(result, Stitch)}
    trusted = sorted(edges)
    while True:
        members = reached(count, trusted)
        trusted = [pair for pair in trusted if pair[0] in members]
        graph = _graph(members, {pair: edges[pair] for pair in trusted})
        solution = optimise(graph)
        refused = [pair for pair, weight in zip(trusted, solution.weights, strict=True) if weight < KEPT]
        if not refused:
            break
        kept = [pair for pair in trusted if pair not in refused]
        trusted = [pair for pair in kept if pair not in undecided(count, kept, refused)]
    covariances = marginals(graph, solution)
    return Network(tuple(members), solution.poses, covariances, results, frozenset(trusted))


def reached(count: int, pairs: Sequence[Pair], start: int = 0) -> list[int]:
    """Maps of ``count`` that hang together with ``start`` over ``pairs``, in ascending order."""
    _, label = connected_components(_adjacency(count, pairs), directed=False)
    return np.flatnonzero(label == label[start]).tolist()


def undecided(count: int, kept: Sequence[Pair], refused: Sequence[Pair]) -> set[Pair]:
    """Kept stitches that are the only ones to speak against a refused one: its ends hang together by them
    alone."""
    return {
        pair
        for pair in kept
        for i, j in refused
        if j in reached(count, kept, i) and j not in reached(count, [p for p in kept if p != pair], i)
    }


def _adjacency(count: int, pairs: Sequence[Pair]) -> coo_array:
    rows, columns = np.array(pairs, dtype=np.int64).reshape(-1, 2).T
    return coo_array((np.ones(len(rows)), (rows, columns)), shape=(count, count))


def _graph(members: list[int], edges: dict[Pair, Stitch]) -> PoseGraph:
    """The graph over the members, every edge in doubt, started along the shortest chains from the first."""
    index = {member: k for k, member in enumerate(members)}
    pairs = [(index[a], index[b]) for a, b in edges]
    T = {pair: stitch.T_a_b for pair, stitch in zip(pairs, edges.values(), strict=True)}
    poses = np.zeros((len(members), 3))
    order, before = breadth_first_order(_adjacency(len(members), pairs).tocsr(), 0, directed=False)
    for k in order[1:]:
        i = int(before[k])
        poses[k] = se2.compose(poses[i], T[i, k] if (i, k) in T else se2.inverse(T[k, i]))
    empty = PoseGraph(poses, np.zeros((0, 2), dtype=np.int64), np.zeros((0, 3)), np.zeros((0, 3, 3)))
    information = [np.linalg.inv(np.asarray(stitch.covariance)) for stitch in edges.values()]
    return empty.with_loops(np.array(pairs), np.array(list(T.values())), np.array(information))
