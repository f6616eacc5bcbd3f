"""Graduated non-convexity over the loops of a pose graph (Yang et al. 2020), in our own Gauss-Newton."""

from __future__ import annotations

import numpy as np

from slam.graph.gauss_newton import Problem
from slam.graph.pose_graph import DEFAULT_GNC, GncConfig, PoseGraph, Solution, chi_squared
from slam.se2 import Array


def solve_gnc(graph: PoseGraph, known: Array | None = None, config: GncConfig = DEFAULT_GNC) -> Solution:
    """Poses and loop weights by truncated least squares, as `slam.graph.pose_graph.optimise` has gtsam do.

    ``known (L,)``: weights the loops had in an earlier solution. If the least squares with these weights
    agree with every one of them they are the answer; otherwise all loops are classified from the start. One
    Gauss-Newton step a round: the weights change little from one to the next. Raises ``ValueError`` where the
    edges leave a pose undetermined.
    """
    problem, loop = Problem.of(graph), graph.loop
    if known is not None:
        poses = problem.descend(graph.poses, _edge_weights(loop, known))
        if np.array_equal(chi_squared(graph, poses)[loop] <= config.limit, known > 0.5):
            return Solution(poses, np.asarray(known))
    ones: Array = np.ones(int(loop.sum()))
    with_all = _solve_from(problem, problem.descend(graph.poses, _edge_weights(loop, ones)), config)
    if np.all(with_all.weights == 1.0):
        return with_all
    with_none = _solve_from(problem, problem.descend(graph.poses, _edge_weights(loop, 0.0 * ones)), config)
    return min(with_all, with_none, key=lambda solution: truncated_cost(problem, solution, config.limit))


def _solve_from(problem: Problem, poses: Array, config: GncConfig) -> Solution:
    """Poses and weights by graduated non-convexity from ``poses`` on.

    The result depends on them: many false loops make least squares bend the graph until the true ones look
    false; without any loop the graph has drifted, and a long true one looks false.
    """
    graph, loop, limit = problem.graph, problem.graph.loop, config.limit
    squared = chi_squared(graph, poses)[loop]
    weights: Array = np.ones(len(squared))
    worst = np.max(squared, initial=0.0)
    if 2.0 * worst > limit:
        mu = min(limit / (2.0 * worst - limit), config.first_mu)
        for _ in range(config.rounds):
            weights = truncated_weights(chi_squared(graph, poses)[loop], mu, limit)
            poses = problem.descend(poses, _edge_weights(loop, weights), iterations=1)
            if np.all((weights == 0.0) | (weights == 1.0)):
                break
            mu *= config.growth
    return Solution(problem.descend(poses, _edge_weights(loop, weights)), weights)


def truncated_cost(problem: Problem, solution: Solution, limit: float) -> float:
    """Twice the truncated least squares of a solution: its χ², and ``limit`` for every rejected loop."""
    kept = _edge_weights(problem.graph.loop, solution.weights)
    return 2.0 * problem.cost(solution.poses, kept) + limit * float(np.sum(1.0 - solution.weights))


def truncated_weights(squared: Array, mu: float, limit: float) -> Array:
    """Weights ``(L,)`` of loops with χ² ``squared (L,)`` in the surrogate of truncated least squares at μ
    (Yang et al. 2020, eq. 14)."""
    between = np.sqrt(limit * mu * (mu + 1.0) / np.maximum(squared, 1e-300)) - mu
    return np.clip(between, 0.0, 1.0)


def _edge_weights(loop: np.ndarray, weights: Array) -> Array:
    edge_weights: Array = np.ones(len(loop))
    edge_weights[loop] = weights
    return edge_weights
