"""Covariances of a pose graph's nodes, from the Cholesky factor of its normal matrix."""

from __future__ import annotations

import numpy as np

from slam import se2
from slam.graph.cholesky import Factor
from slam.graph.gauss_newton import Problem
from slam.graph.pose_graph import PoseGraph, Solution
from slam.se2 import Array


def marginals(graph: PoseGraph, solution: Solution) -> Array:
    """Covariances ``(K, 3, 3)`` in the body frame at a solution, without the loops it switched off.

    Raises ``ValueError`` where the edges leave a pose undetermined.
    """
    trusted = graph.with_only(solution.weights > 0.5)
    factor, _ = Problem.of(trusted).factor(solution.poses, np.ones(len(trusted.edges)))
    return factor.inverse_blocks()


def relative_covariance(
    factor: Factor, marginal: Array, poses: Array, seen_from: np.ndarray, b: int
) -> Array:
    """Covariances ``(n, 3, 3)`` of pose b seen from those of ``poses (K, 3)`` that ``seen_from (n,)`` names.

    They are in the tangent of b; ``factor`` is that of the graph's normal matrix, ``marginal (K, 3, 3)`` its
    `Factor.inverse_blocks`.
    """
    unit: Array = np.zeros((len(poses), 3, 3))
    unit[b] = np.eye(3)
    cross = factor.solve(unit)[seen_from]  # of every pose a with b: rows a, columns b
    A = se2.adjoint(se2.between(poses[b], poses[seen_from]))
    mixed = A @ cross
    own = A @ marginal[seen_from] @ np.swapaxes(A, 1, 2)
    return marginal[b] - mixed - np.swapaxes(mixed, 1, 2) + own
