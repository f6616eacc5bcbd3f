"""Least squares over a pose graph: Gauss-Newton steps by a sparse Cholesky factor.

Minimises what `slam.graph.pose_graph.optimise` has gtsam minimise, and ends at the same poses (2e-6 m), in a
tenth of its time, with graduated non-convexity in a twenty-eighth: 1.7 against 17 ms, 2.1 against 59 ms for
hospital's 88 nodes, 188 edges and 14 loops (the snippet in docs/pose_graph.md prints it; 2026-12, one core).
Nothing is built edge by edge in Python, and an INS's steps need no rounds of their own. That is why it solves
the graph after every stitch and the bundle, which also needs fixed poses; gtsam solves the final graph once.
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
"""Most steps of one descent; three usually suffice."""

SETTLED = 1e-5
"""Largest change of a pose (m, rad) at which a descent ends."""

DAMPING = 1e-3
"""Levenberg-Marquardt damping, relative to the diagonal, after a step that made the cost larger; each further
one makes it ten times as large."""


@dataclass(frozen=True)
class Problem:
    """A pose graph with its symbolic factorisation, so that Gauss-Newton can be run repeatedly with other
    poses and weights.

    ``block_index`` is the off-diagonal block in ``structure`` of each residual (edges, then an INS's steps);
    one past the last where one of its poses is ``fixed (K,)``.
    """

    graph: PoseGraph
    structure: Structure
    block_index: np.ndarray
    fixed: np.ndarray

    @classmethod
    def of(cls, graph: PoseGraph, fixed: np.ndarray | None = None) -> Problem:
        """The problem of a graph; node 0 has a prior where ``graph.poses`` has it, and nodes that ``fixed
        (K,)`` bool marks (default: none) do not move at all."""
        steps = graph.world_steps
        pairs = graph.edges if steps is None else np.concatenate([graph.edges, steps.edges])
        fixed = np.zeros(len(graph.poses), dtype=bool) if fixed is None else fixed
        free = ~np.any(fixed[pairs], axis=1)
        structure = Structure.of(pairs[free], len(graph.poses))
        block_index = np.full(len(pairs), structure.blocks)
        block_index[free] = structure.block_index(pairs[free])
        return cls(graph, structure, block_index, fixed)

    def descend(self, poses: Array, weights: Array, iterations: int = ITERATIONS) -> Array:
        """Poses ``(K, 3)`` of least cost near ``poses`` when edge e counts ``weights (E,)`` times.

        Raises ``ValueError`` where the edges leave a pose undetermined.
        """
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
        """Factor of the normal matrix at ``poses``, and the cost's gradient ``(K, 3)`` in the body tangents.

        Raises ``ValueError`` where the edges leave a pose undetermined.
        """
        from slam.graph.gauss_newton_kernels import normal_equations

        terms = self._terms(weights)
        diagonal, lower, gradient = normal_equations(
            poses, *terms, self.block_index, self.structure.blocks + 1
        )
        diagonal[:, range(3), range(3)] *= 1.0 + damping
        diagonal[self.fixed], gradient[self.fixed] = np.eye(3), 0.0
        diagonal = diagonal[np.argsort(self.structure.position)]
        factor = Factor.of(self.structure, diagonal, lower[:-1])
        if factor is None:
            raise ValueError("pose graph: its edges leave a pose undetermined")
        return factor, gradient

    def _terms(self, weights: Array) -> tuple[Any, Any, Any]:
        """Edges, INS steps and the prior of node 0 as the kernels take them."""
        graph, steps = self.graph, self.graph.world_steps
        scales = np.where(graph.heavy_tailed, CAUCHY**2, np.inf)
        edges = (graph.edges, graph.T_ij, graph.information, np.asarray(weights, dtype=np.float64), scales)
        none = (np.zeros((0, 2), dtype=np.int64), np.zeros((0, 2)), np.zeros(0))
        ins = none if steps is None else (steps.edges, steps.displacement, steps.variance)
        return edges, ins, (graph.poses[0], np.array(ANCHOR_SIGMAS) ** -2)
