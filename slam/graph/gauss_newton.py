"""Least squares over a pose graph by Gauss-Newton steps, robust against false loops, and its covariances.

Minimises what `slam.graph.pose_graph.optimise` has gtsam minimise, and ends at the same poses (2e-6 m), in a
tenth of its time, with graduated non-convexity in a twenty-eighth (docs/pose_graph.md). That is why it solves
the graph after every stitch and the bundle, which also needs fixed poses; gtsam solves the final graph once.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numba import njit

from slam import se2
from slam.graph.cholesky import Factor, Structure
from slam.graph.pose_graph import (
    ANCHOR_SIGMAS,
    CAUCHY,
    DEFAULT_GNC,
    GncConfig,
    PoseGraph,
    Solution,
    chi_squared,
)
from slam.se2 import Array

ITERATIONS = 20
"""Most steps of one descent; three usually suffice."""

SETTLED = 1e-5
"""Largest change of a pose (m, rad) at which a descent ends."""

DAMPING = 1e-3
"""Levenberg-Marquardt damping, relative to the diagonal, after a step that made the cost larger; each further
one makes it ten times as large."""

Edges = tuple[np.ndarray, Array, Array, Array, Array]
"""Nodes ``(E, 2)``, measured relative poses ``(E, 3)``, information ``(E, 3, 3)``, weights ``(E,)`` and the
squares ``(E,)`` of the scales of Cauchy kernels, infinite where the errors are normal."""

Steps = tuple[np.ndarray, Array, Array]
"""Nodes ``(W, 2)``, displacements ``(W, 2)`` and variances ``(W,)`` of an INS's steps in its world frame."""

Pin = tuple[Array, Array]
"""Prior of node 0: its pose ``(3,)``, and the information ``(3,)`` of its axes."""


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
        pairs = np.concatenate([graph.edges, graph.world_steps.edges])
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
        return float(cost_of(poses, *self._terms(weights)))

    def factor(self, poses: Array, weights: Array, damping: float = 0.0) -> tuple[Factor, Array]:
        """Factor of the normal matrix at ``poses``, and the cost's gradient ``(K, 3)`` in the body tangents.

        Raises ``ValueError`` where the edges leave a pose undetermined.
        """
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

    def _terms(self, weights: Array) -> tuple[Edges, Steps, Pin]:
        """Edges, INS steps and the prior of node 0 as the kernels take them."""
        graph, steps = self.graph, self.graph.world_steps
        scales = np.where(graph.heavy_tailed, CAUCHY**2, np.inf)
        edges = (graph.edges, graph.T_ij, graph.information, np.asarray(weights, dtype=np.float64), scales)
        ins = (steps.edges, steps.displacement, steps.variance)
        return edges, ins, (graph.poses[0], np.array(ANCHOR_SIGMAS) ** -2)


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

    def cost(solution: Solution) -> float:
        """Twice the truncated least squares: χ² of what is kept, and the limit for every rejected loop."""
        kept = problem.cost(solution.poses, _edge_weights(loop, solution.weights))
        return 2.0 * kept + config.limit * float(np.sum(1.0 - solution.weights))

    return min(with_all, with_none, key=cost)


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


def truncated_weights(squared: Array, mu: float, limit: float) -> Array:
    """Weights ``(L,)`` of loops with χ² ``squared (L,)`` in the surrogate of truncated least squares at μ
    (Yang et al. 2020, eq. 14)."""
    between = np.sqrt(limit * mu * (mu + 1.0) / np.maximum(squared, 1e-300)) - mu
    return np.clip(between, 0.0, 1.0)


def _edge_weights(loop: np.ndarray, weights: Array) -> Array:
    edge_weights: Array = np.ones(len(loop))
    edge_weights[loop] = weights
    return edge_weights


def settle(graph: PoseGraph, fixed: np.ndarray | None = None, iterations: int = ITERATIONS) -> PoseGraph:
    """The graph at the poses of least cost near its own, every edge counting fully; see `Problem`."""
    weights = np.ones(len(graph.edges))
    return replace(graph, poses=Problem.of(graph, fixed).descend(graph.poses, weights, iterations))


def factor_of(graph: PoseGraph, poses: Array, fixed: np.ndarray | None = None) -> Factor:
    """Factor of a graph's normal matrix at ``poses (K, 3)``, every edge counting fully.

    Raises ``ValueError`` where the edges leave a pose undetermined.
    """
    return Problem.of(graph, fixed).factor(poses, np.ones(len(graph.edges)))[0]


def marginals(graph: PoseGraph, solution: Solution) -> Array:
    """Covariances ``(K, 3, 3)`` in the body frame at a solution, without the loops it switched off.

    Raises ``ValueError`` where the edges leave a pose undetermined.
    """
    return factor_of(graph.with_only(solution.weights > 0.5), solution.poses).inverse_blocks()


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


@njit(cache=True)
def _between(a: Array, b: Array) -> tuple[float, float, float]:
    """Pose b seen from a; its yaw is not wrapped."""
    c, s = np.cos(a[2]), np.sin(a[2])
    dx, dy = b[0] - a[0], b[1] - a[1]
    return c * dx + s * dy, c * dy - s * dx, b[2] - a[2]


@njit(cache=True)
def _residual(measured: Array, x: float, y: float, yaw: float) -> Array:
    """Tangent ``(3,)`` that leads from the measured pose to (x, y, yaw)."""
    c, s = np.cos(measured[2]), np.sin(measured[2])
    dx, dy = x - measured[0], y - measured[1]
    along, across = c * dx + s * dy, c * dy - s * dx
    turn = (yaw - measured[2] + np.pi) % (2.0 * np.pi) - np.pi
    if abs(turn) < 1e-4:
        sinc, cosc = 1.0 - turn**2 / 6.0, turn / 2.0 - turn**3 / 24.0
    else:
        sinc, cosc = np.sin(turn) / turn, (1.0 - np.cos(turn)) / turn
    scale = 1.0 / (sinc**2 + cosc**2)
    return np.array([scale * (sinc * along + cosc * across), scale * (sinc * across - cosc * along), turn])


@njit(cache=True)
def _log_derivative(r: Array) -> Array:
    """Derivative ``(3, 3)`` of the tangent ``r`` of a pose by a further one in its body (Chirikjian 2012)."""
    half = 0.5 * r[2]
    if abs(r[2]) < 1e-4:
        cotangent, rest = 1.0 - r[2] ** 2 / 12.0, r[2] / 12.0
    else:
        cotangent = half / np.tan(half)
        rest = (1.0 - cotangent) / r[2]
    D = np.zeros((3, 3))
    D[0, 0], D[0, 1], D[0, 2] = cotangent, -half, rest * r[0] + 0.5 * r[1]
    D[1, 0], D[1, 1], D[1, 2] = half, cotangent, rest * r[1] - 0.5 * r[0]
    D[2, 2] = 1.0
    return D


@njit(cache=True)
def _squared(information: Array, r: Array) -> float:
    total = 0.0
    for a in range(3):
        for b in range(3):
            total += r[a] * information[a, b] * r[b]
    return total


@njit(cache=True)
def cost_of(poses: Array, edges: Edges, steps: Steps, pin: Pin) -> float:
    """Half the weighted sum of squared normalised residuals at ``poses (K, 3)``."""
    total = 0.0
    for e in range(len(edges[3])):
        x, y, yaw = _between(poses[edges[0][e, 0]], poses[edges[0][e, 1]])
        squared, scale = _squared(edges[2][e], _residual(edges[1][e], x, y, yaw)), edges[4][e]
        total += edges[3][e] * (squared if np.isinf(scale) else scale * np.log1p(squared / scale))
    for w in range(len(steps[2])):
        i, j = steps[0][w]
        for axis in range(2):
            total += (poses[j, axis] - poses[i, axis] - steps[1][w, axis]) ** 2 / steps[2][w]
    r = _residual(pin[0], poses[0, 0], poses[0, 1], poses[0, 2])
    for axis in range(3):
        total += pin[1][axis] * r[axis] ** 2
    return 0.5 * total


@njit(cache=True)
def _add(a: Array, b: Array, L: Array, r: Array, out: Array, gradient: Array) -> None:
    """``out += aᵀ L b`` and ``gradient += aᵀ L r``."""
    for row in range(3):
        for k in range(3):
            left = a[0, row] * L[0, k] + a[1, row] * L[1, k] + a[2, row] * L[2, k]
            gradient[row] += left * r[k]
            for column in range(3):
                out[row, column] += left * b[k, column]


@njit(cache=True)
def _add_pair(i: int, j: int, block: int, A: Array, information: Array, r: Array,
              blocks: tuple[Array, Array], gradient: Array) -> None:  # fmt: skip
    """Add the residual ``r`` between nodes i and j with its derivatives ``A (2, 3, 3)`` to the diagonal and
    lower blocks and the gradient."""
    unused = np.zeros(3)
    _add(A[0], A[0], information, r, blocks[0][i], gradient[i])
    _add(A[1], A[1], information, r, blocks[0][j], gradient[j])
    if block >= 0:
        _add(A[0], A[1], information, r, blocks[1][block], unused)
    else:
        _add(A[1], A[0], information, r, blocks[1][-1 - block], unused)


@njit(cache=True)
def normal_equations(
    poses: Array, edges: Edges, steps: Steps, pin: Pin, block_index: np.ndarray, lower_blocks: int
) -> tuple[Array, Array, Array]:
    """Diagonal blocks ``(K, 3, 3)``, lower blocks ``(lower_blocks, 3, 3)`` and gradient ``(K, 3)``.

    ``block_index`` of the edges and then of the INS's steps is `slam.graph.cholesky.Structure.block_index`.
    """
    blocks = np.zeros((len(poses), 3, 3)), np.zeros((lower_blocks, 3, 3))
    gradient, A, r = np.zeros(poses.shape), np.zeros((2, 3, 3)), np.zeros(3)
    for e in range(len(edges[3])):
        i, j = edges[0][e]
        x, y, yaw = _between(poses[i], poses[j])
        r = _residual(edges[1][e], x, y, yaw)
        x, y, yaw = _between(poses[j], poses[i])
        c, s = np.cos(yaw), np.sin(yaw)
        A[1] = _log_derivative(r)
        for row in range(3):
            along, across, turned = A[1, row]
            A[0, row, 0] = -c * along - s * across
            A[0, row, 1] = s * along - c * across
            A[0, row, 2] = x * across - y * along - turned
        weight = edges[3][e] / (1.0 + _squared(edges[2][e], r) / edges[4][e])
        _add_pair(i, j, block_index[e], A, weight * edges[2][e], r, blocks, gradient)
    A[:] = 0.0
    r[2] = 0.0
    for w in range(len(steps[2])):
        i, j = steps[0][w]
        for end in range(2):
            c, s = np.cos(poses[steps[0][w, end], 2]), np.sin(poses[steps[0][w, end], 2])
            sign = 2.0 * end - 1.0
            A[end, 0, 0], A[end, 0, 1], A[end, 1, 0], A[end, 1, 1] = sign * c, -sign * s, sign * s, sign * c
        r[:2] = poses[j, :2] - poses[i, :2] - steps[1][w]
        information = np.diag(np.array([1.0, 1.0, 0.0])) / steps[2][w]
        _add_pair(i, j, block_index[len(edges[3]) + w], A, information, r, blocks, gradient)
    r = _residual(pin[0], poses[0, 0], poses[0, 1], poses[0, 2])
    for axis in range(3):
        blocks[0][0, axis, axis] += pin[1][axis]
        gradient[0, axis] += pin[1][axis] * r[axis]
    return blocks[0], blocks[1], gradient
