"""Least squares over a pose graph: Gauss-Newton steps by a sparse Cholesky factor.

Minimises what `slam.graph.pose_graph.optimise` has gtsam minimise, and ends at the same poses.
Quick enough to be done again for every stitch: nothing is built edge by edge in Python, and an INS's steps
need no rounds of their own.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from slam import se2
from slam.graph.cholesky import Factor, Structure
from slam.graph.pose_graph import ANCHOR_SIGMAS, CAUCHY, PoseGraph
from slam.se2 import Array

ITERATIONS = 20
"""Most steps of one descent; three usually do."""

SETTLED = 1e-5
"""Largest change of a pose (m, rad) at which a descent ends."""

DAMPING = 1e-3
"""Share of the diagonal that is added to it where a full step made the cost larger; then ten times more."""


@dataclass(frozen=True)
class Problem:
    """A graph made ready for descents from any poses, with any weights of its edges.

    ``places`` says where in ``structure`` the blocks between the two poses of each residual belong: behind
    its last one where a pose is ``held (K,)``.
    """

    graph: PoseGraph
    structure: Structure
    places: np.ndarray
    held: np.ndarray

    @classmethod
    def of(cls, graph: PoseGraph, held: np.ndarray | None = None) -> Problem:
        """The problem of a graph; node 0 is pinned where ``graph.poses`` has it, and those that ``held (K,)``
        bool marks (default: none) do not move at all."""
        steps = graph.world_steps
        pairs = graph.edges if steps is None else np.concatenate([graph.edges, steps.edges])
        held = np.zeros(len(graph.poses), dtype=bool) if held is None else held
        free = ~np.any(held[pairs], axis=1)
        structure = Structure.of(pairs[free], len(graph.poses))
        places = np.full(len(pairs), structure.blocks)
        places[free] = structure.places(pairs[free])
        return cls(graph, structure, places, held)

    def descend(self, poses: Array, weights: Array, iterations: int = ITERATIONS) -> Array:
        """Poses ``(K, 3)`` of least cost near ``poses`` when edge e counts ``weights (E,)`` times."""
        from slam.graph.gauss_newton_kernels import cost_of

        terms = self._terms(weights)
        cost, damping = cost_of(poses, *terms), 0.0
        for _ in range(iterations):
            factor, gradient = self.factor(poses, weights, damping)
            step = -factor.solve(gradient[..., None])[..., 0]
            moved = se2.compose(poses, se2.exp(step))
            if np.max(np.abs(step)) < SETTLED:
                return moved
            after = cost_of(moved, *terms)
            if after <= cost:
                poses, cost, damping = moved, after, 0.1 * damping if damping > DAMPING else 0.0
            else:
                damping = max(10.0 * damping, DAMPING)
        return poses

    def cost(self, poses: Array, weights: Array) -> float:
        """Half the sum of squared normalised residuals, edges counting by ``weights (E,)``."""
        from slam.graph.gauss_newton_kernels import cost_of

        return float(cost_of(poses, *self._terms(weights)))

    def factor(self, poses: Array, weights: Array, damping: float = 0.0) -> tuple[Factor, Array]:
        """Factor of the normal matrix at ``poses``, and the cost's gradient ``(K, 3)`` by the body tangents.

        Raises ``ValueError`` where the edges leave a pose undetermined.
        """
        from slam.graph.gauss_newton_kernels import normal_equations

        terms = self._terms(weights)
        diagonal, lower, gradient = normal_equations(poses, *terms, self.places, self.structure.blocks + 1)
        diagonal[:, range(3), range(3)] *= 1.0 + damping
        diagonal[self.held], gradient[self.held] = np.eye(3), 0.0
        diagonal = diagonal[np.argsort(self.structure.position)]
        factor = Factor.of(self.structure, diagonal, lower[:-1])
        if factor is None:
            raise ValueError("pose graph: its edges leave a pose undetermined")
        return factor, gradient

    def _terms(self, weights: Array) -> tuple[Any, Any, Any]:
        """Edges, INS steps and pin as the kernels want them."""
        graph, steps = self.graph, self.graph.world_steps
        scales = np.where(graph.heavy, CAUCHY**2, np.inf)
        edges = (graph.edges, graph.T_ij, graph.information, np.asarray(weights, dtype=np.float64), scales)
        none = (np.zeros((0, 2), dtype=np.int64), np.zeros((0, 2)), np.zeros(0))
        ins = none if steps is None else (steps.edges, steps.displacement, steps.variance)
        return edges, ins, (graph.poses[0], np.array(ANCHOR_SIGMAS) ** -2)
