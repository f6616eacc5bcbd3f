"""Pairwise consistency maximisation: the largest set of loops that agree with each other (Mangelson 2018)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from slam import se2
from slam.graph.pose_graph import PoseGraph, joint_covariance, optimise
from slam.se2 import Array

THRESHOLD = 11.345
"""χ²₃(0.99): two loops whose cycle misses by more do not agree."""

MOST_STEPS = 20_000
"""Branches after which the search for the largest set ends with the largest found so far."""


def consistent_loops(graph: PoseGraph) -> np.ndarray:
    """Which loops ``(L,)`` bool of a graph, in their order, belong to the largest set that agrees pairwise.

    What lies between the loops is known from the graph without them. That set is a largest clique; of equally
    large ones, the first found. No loop is judged alone: a single one is always consistent.
    """
    kept = np.zeros(int(graph.loop.sum()), dtype=bool)
    kept[largest_clique(disagreement(graph) < THRESHOLD)] = True
    return kept


def disagreement(graph: PoseGraph) -> Array:
    """Squared Mahalanobis distance ``(L, L)`` from identity of the cycle through every two loops.

    Loop i→k and loop j→l make the cycle ``z_ik⁻¹ x_ij z_jl x_lk`` (Mangelson et al. 2018); the
    covariance of ``x_ij`` and ``x_lk``, with what they share, is that of the graph without loops. The
    diagonal is zero.
    """
    bare = graph.with_only(np.zeros(int(graph.loop.sum()), dtype=bool))
    bare = replace(bare, poses=optimise(bare, "none").poses)
    joint = joint_covariance(bare).reshape(len(bare.poses), 3, len(bare.poses), 3).swapaxes(1, 2)
    (i, k), z = graph.edges[graph.loop].T, graph.T_ij[graph.loop]
    sigma = np.linalg.pinv(graph.information[graph.loop], hermitian=True)
    found: Array = np.zeros((len(z), len(z)))
    for a in range(len(z) - 1):
        others = np.arange(a + 1, len(z))
        found[a, others] = _cycles(bare.poses, joint, i, k, z, sigma, a, others)
    return found + found.T


def _cycles(
    poses: Array, joint: Array, i: np.ndarray, k: np.ndarray, z: Array, sigma: Array, a: int, b: np.ndarray
) -> Array:
    """Squared distances ``(n,)`` of the cycles through loop ``a`` and loops ``b (n,)``.

    An error ξ of a pose within the cycle moves its end by Ad(rest⁻¹) ξ, where rest is what follows it.
    """
    x_ij, x_lk = se2.between(poses[i[a]], poses[i[b]]), se2.between(poses[k[b]], poses[k[a]])
    to_l = se2.compose(z[b], x_lk)
    to_j = se2.compose(x_ij, to_l)
    cycle = se2.compose(se2.inverse(z[a]), to_j)
    nodes = np.stack([np.full(len(b), i[a]), i[b], k[b], np.full(len(b), k[a])], axis=1)
    moves = np.stack(
        [
            -se2.adjoint(se2.inverse(to_j)),
            se2.adjoint(se2.inverse(to_l)),
            -se2.adjoint(se2.inverse(x_lk)),
            np.tile(np.eye(3), (len(b), 1, 1)),
        ],
        axis=1,
    )
    blocks = joint[nodes[:, :, None], nodes[:, None, :]]
    covariance = np.einsum("nsab,nstbc,ntdc->nad", moves, blocks, moves, optimize=True)
    covariance += se2.transport(sigma[a], se2.inverse(cycle)) + se2.transport(sigma[b], se2.inverse(x_lk))
    error = se2.log(cycle)
    return np.einsum("na,na->n", error, np.linalg.solve(covariance, error[..., None])[..., 0])


def largest_clique(adjacent: np.ndarray, most_steps: int = MOST_STEPS) -> list[int]:
    """Ascending members of a largest clique of an undirected graph ``(L, L)`` bool.

    Branch and bound with greedy colouring (Tomita & Seki 2003); after ``most_steps`` branches the largest
    found so far. Sets of vertices are the bits of integers.
    """
    n = len(adjacent)
    neighbours = [sum(1 << int(j) for j in np.flatnonzero(row) if j != v) for v, row in enumerate(adjacent)]
    best: list[int] = []
    waiting: list[tuple[list[int], int]] = [([], (1 << n) - 1)]
    for _ in range(most_steps):
        if not waiting:
            break
        clique, candidates = waiting.pop()
        if not candidates and len(clique) > len(best):
            best = clique
        branches = []
        for v, colours in reversed(_coloured(candidates, neighbours)):
            if len(clique) + colours <= len(best):
                break
            branches.append(([*clique, v], candidates & neighbours[v]))
            candidates &= ~(1 << v)
        waiting += reversed(branches)
    return sorted(best)


def _coloured(candidates: int, neighbours: list[int]) -> list[tuple[int, int]]:
    """The candidates, each with the number of colours that it and those before it need at most."""
    found, colour = [], 0
    while candidates:
        colour, free = colour + 1, candidates
        while free:
            v = (free & -free).bit_length() - 1
            found.append((v, colour))
            free &= ~(neighbours[v] | (1 << v))
            candidates &= ~(1 << v)
    return found
