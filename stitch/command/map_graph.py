"""A pose graph of any number of maps: every pair stitched, contradictory stitches rejected."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Any

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import breadth_first_order, connected_components

from slam import se2
from slam.graph.gauss_newton import marginals
from slam.graph.pose_graph import PoseGraph, optimise
from slam.mapping.submap import Submap
from slam.se2 import Array
from slam.table import Table, number
from stitch.alignment.result import NoStitch, Stitch
from stitch.command.maps import as_json, between_maps, deviations, margin, pose_between_maps

Pair = tuple[int, int]
COLUMNS = ["map", "in the frame of", "verdict", "x [m]", "y [m]", "yaw [°]"]
COLUMNS += ["overlap [m²]", "agreement", "margin"]
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
    information = [np.linalg.inv(np.asarray(stitch.covariance)) for stitch in edges.values()]
    return PoseGraph(poses).with_loops(np.array(pairs), np.array(list(T.values())), np.array(information))


def graph_between_maps(submaps: Sequence[Submap], graph: MapGraph) -> MapGraph:
    """A graph of anchors as one of their maps."""
    members = [submaps[k] for k in graph.members]
    return replace(
        graph,
        poses=np.array(
            [pose_between_maps(submaps[0], b, T) for b, T in zip(members, graph.poses, strict=True)]
        ),
        covariances=np.array(
            [se2.transport(sigma, b.anchor) for b, sigma in zip(members, graph.covariances, strict=True)]
        ),
        results={(a, b): between_maps(submaps[a], submaps[b], r) for (a, b), r in graph.results.items()},
    )


def graph_json(graph: MapGraph, names: Sequence[str]) -> dict[str, Any]:
    """Many maps joined: where each lies in the frame of the first, and every pair that was tried."""
    joined = len(graph.members) > 1
    maps = zip(graph.members, graph.poses, graph.covariances, strict=True)
    return {
        "accepted": joined,
        "reason": None if joined else f"no map could be joined to {names[0]}",
        "maps": [
            {"map": names[k], "T_first_map": T.tolist(), "std": deviations(T, sigma).tolist()}
            for k, T, sigma in maps
        ],
        "left_out": [name for k, name in enumerate(names) if k not in graph.members],
        "pairs": [
            {"a": names[a], "b": names[b], **as_json(result), "used": (a, b) in graph.trusted}
            for (a, b), result in graph.results.items()
        ],
    }


def pairs_table(graph: MapGraph, names: Sequence[str]) -> Table:
    """Every pair of maps tried, given between the maps, with the reasons against as notes."""
    rows, notes = [], []
    for (a, b), result in graph.results.items():
        if isinstance(result, NoStitch):
            rows.append((names[b], names[a], "no", *[""] * 6))
            notes.append(f"{names[b]} in {names[a]}: no: {result.reason}")
            continue
        trusted = (a, b) in graph.trusted
        if not trusted:
            notes.append(f"{names[b]} in {names[a]}: not used: contradicted, or apart from the first map")
        x, y, yaw = result.T_a_b
        rows.append(
            (
                names[b],
                names[a],
                "joined" if trusted else "not used",
                *(number(x), number(y), number(np.degrees(yaw), 2), number(result.overlap_area, 1)),
                *(number(result.agreement, 2), number(margin(result), 2)),
            )
        )
    return Table(COLUMNS, rows, names=3, notes=notes)
