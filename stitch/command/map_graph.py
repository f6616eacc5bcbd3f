"""A pose graph of any number of maps: every pair stitched, contradictory stitches rejected."""

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
MIN_WEIGHT = 0.5
"""Graduated non-convexity leaves weights near 0 or 1: stitches below this are rejected."""


@dataclass(frozen=True)
class MapGraph:
    """Maps joined to the first one.

    ``members``: indices of the M maps joined, in ascending order; ``poses (M, 3)``: theirs in the frame of
    the first; ``covariances (M, 3, 3)``; ``results`` of all pairs tried; ``trusted``: the pairs whose
    stitches are the edges.
    """

    members: tuple[int, ...]
    poses: Array
    covariances: Array
    results: dict[Pair, Stitch | NoStitch]
    trusted: frozenset[Pair]


def join(count: int, stitch: Callable[[int, int], Stitch | NoStitch]) -> MapGraph:
    """Stitch every pair of ``count`` maps and join those that are connected with the first.

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
        rejected = [
            pair for pair, weight in zip(trusted, solution.weights, strict=True) if weight < MIN_WEIGHT
        ]
        if not rejected:
            break
        kept = [pair for pair in trusted if pair not in rejected]
        trusted = [pair for pair in kept if pair not in undecided(count, kept, rejected)]
    covariances = marginals(graph, solution)
    return MapGraph(tuple(members), solution.poses, covariances, results, frozenset(trusted))


def reached(count: int, pairs: Sequence[Pair], start: int = 0) -> list[int]:
    """Maps of ``count`` that are connected with ``start`` by ``pairs``, in ascending order."""
    _, label = connected_components(_adjacency(count, pairs), directed=False)
    return np.flatnonzero(label == label[start]).tolist()


def undecided(count: int, kept: Sequence[Pair], rejected: Sequence[Pair]) -> set[Pair]:
    """Kept stitches without which the two maps of a rejected one would no longer be connected."""
    return {
        pair
        for pair in kept
        for i, j in rejected
        if j in reached(count, kept, i) and j not in reached(count, [p for p in kept if p != pair], i)
    }


def _adjacency(count: int, pairs: Sequence[Pair]) -> coo_array:
    rows, columns = np.array(pairs, dtype=np.int64).reshape(-1, 2).T
    return coo_array((np.ones(len(rows)), (rows, columns)), shape=(count, count))


def _graph(members: list[int], edges: dict[Pair, Stitch]) -> PoseGraph:
    """The graph over the members, every edge a loop, with poses along the shortest chains from the first."""
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
