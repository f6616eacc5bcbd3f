"""How well a pose graph knows where one of its poses lies as seen from another."""

from __future__ import annotations

import numpy as np

from slam import se2
from slam.graph.cholesky import Factor
from slam.se2 import Array


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
