"""Graduated non-convexity over the loops of a pose graph (Yang et al. 2020), quick."""

from __future__ import annotations

import numpy as np
from scipy.stats import chi2

from slam.graph.gauss_newton import Problem
from slam.graph.pose_graph import INLIER_PROBABILITY, PoseGraph, Solution, chi_squared
from slam.se2 import Array

LIMIT = float(chi2.ppf(INLIER_PROBABILITY, 3))
"""χ² beyond which a loop is an outlier."""

FIRST_MU = 0.1
"""μ at which the rounds begin at the latest: there a loop counts by its error, not by its square.

Beginning at the μ of the worst loop (as gtsam does) ends at higher costs where the plain least squares hide
false loops by bending the graph.
"""

GROWTH = 1.4
"""By what μ grows from one round to the next, as in gtsam."""

ROUNDS = 100
"""Most rounds, as in gtsam."""


def judge(graph: PoseGraph, known: Array | None = None) -> Solution:
    """Poses and weights by truncated least squares, as `slam.graph.pose_graph.optimise` has gtsam find them.

    ``known (L,)``: weights that the loops are thought to have. Where the least squares with these weights
    agree with every one of them they are the answer; else all loops are judged anew, from the start. One
    Gauss-Newton step a round: the weights change little from one to the next.
    """
    problem, loop = Problem.of(graph), graph.loop
    if known is not None:
        poses = problem.descend(graph.poses, _edge_weights(loop, known))
        if np.array_equal(chi_squared(graph, poses)[loop] <= LIMIT, known > 0.5):
            return Solution(poses, np.asarray(known))
    everyone: Array = np.ones(int(loop.sum()))
    first = graduated(problem, problem.descend(graph.poses, _edge_weights(loop, everyone)))
    if np.all(first.weights == 1.0):
        return first
    second = graduated(problem, problem.descend(graph.poses, _edge_weights(loop, 0.0 * everyone)))
    return min(first, second, key=lambda solution: cost(problem, solution))


def graduated(problem: Problem, poses: Array) -> Solution:
    """Poses and weights by graduated non-convexity from ``poses`` on.

    Where it ends depends on them: with many a false loop least squares bend the graph until the true ones
    look false; without any loop the graph has drifted, and a long one does not look true.
    """
    graph, loop = problem.graph, problem.graph.loop
    squared = chi_squared(graph, poses)[loop]
    weights: Array = np.ones(len(squared))
    worst = np.max(squared, initial=0.0)
    if 2.0 * worst > LIMIT:
        mu = min(LIMIT / (2.0 * worst - LIMIT), FIRST_MU)
        for _ in range(ROUNDS):
            weights = truncated(chi_squared(graph, poses)[loop], mu)
            poses = problem.descend(poses, _edge_weights(loop, weights), iterations=1)
            if np.all((weights == 0.0) | (weights == 1.0)):
                break
            mu *= GROWTH
    return Solution(problem.descend(poses, _edge_weights(loop, weights)), weights)


def cost(problem: Problem, solution: Solution) -> float:
    """Twice the truncated least squares of a solution: its χ², and `LIMIT` for every loop that is out."""
    kept = _edge_weights(problem.graph.loop, solution.weights)
    return 2.0 * problem.cost(solution.poses, kept) + LIMIT * float(np.sum(1.0 - solution.weights))


def truncated(squared: Array, mu: float) -> Array:
    """Weights ``(L,)`` of the surrogate of truncated least squares at μ (Yang et al. 2020, eq. 14)."""
    between = np.sqrt(LIMIT * mu * (mu + 1.0) / np.maximum(squared, 1e-300)) - mu
    return np.clip(between, 0.0, 1.0)


def _edge_weights(loop: np.ndarray, weights: Array) -> Array:
    whole: Array = np.ones(len(loop))
    whole[loop] = weights
    return whole
