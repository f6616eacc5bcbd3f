"""The pose graph: nodes, relative poses between them, and their batch optimisation by gtsam."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np

from slam import se2
from slam.se2 import Array

Loss = Literal["gnc", "none"]

ANCHOR_SIGMAS = (1e-3, 1e-3, 1e-4)
"""Standard deviations (m, m, rad) of the prior that pins node 0."""

RELINEARISATIONS = 5
"""Most rounds in which an INS's world-frame steps are linearised anew; three usually do."""

SETTLED = 1e-3
"""Largest change of a pose (m, rad) at which such rounds end."""

FAR_OFF = 9.0
"""Mean χ² of an edge's residuals, at the given poses, from which on LAGO's poses are tried too."""

NOTHING = 1e-9
"""χ² of a graph whose edges agree."""

LARGEST_SIGMA = 1e6
"""Of a direction (m, m, rad) in which an edge knows nothing, as LAGO is told it."""

CAUCHY = 2.385
"""Scale, in standard deviations, of the Cauchy kernel of heavy-tailed edges: 95 % efficient on Gaussian
errors."""


@dataclass(frozen=True)
class GncConfig:
    """Graduated non-convexity over the loops of a graph (Yang et al. 2020); gtsam reads the first only."""

    inlier_probability: float = 0.99
    """Quantile of χ²₃ beyond which a loop is an outlier."""
    first_mu: float = 0.1
    """Largest μ of the first round, where a loop counts by its error and not by its square. That of the worst
    loop, as in gtsam, ends at higher costs where least squares hide false loops by bending the graph."""
    growth: float = 1.4
    """Factor on μ from one round to the next, as in gtsam."""
    rounds: int = 100
    """Most rounds, as in gtsam."""

    @property
    def limit(self) -> float:
        """χ² beyond which a loop is an outlier."""
        return se2.max_distance(self.inlier_probability)


DEFAULT_GNC = GncConfig()


@dataclass(frozen=True)
class WorldSteps:
    """Position increments of an INS in its own world frame: ``t_j − t_i = displacement``, whatever the
    yaw is; by default none.

    ``edges (W, 2)`` node indices, ``displacement (W, 2)`` m, ``variance (W,)`` m² per axis.
    """

    edges: np.ndarray = field(default_factory=lambda: np.zeros((0, 2), dtype=np.int64))
    displacement: Array = field(default_factory=lambda: np.zeros((0, 2)))
    variance: Array = field(default_factory=lambda: np.zeros(0))

    def __len__(self) -> int:
        return len(self.variance)


@dataclass(frozen=True)
class PoseGraph:
    """Poses ``(K, 3)`` and E relative poses between them, by default none.

    ``edges (E, 2)`` indices i, j into ``poses``; ``T_ij (E, 3)``; ``information (E, 3, 3)`` in the
    tangent of j, positive semi-definite, singular where a direction is unknown; ``loop (E,)`` True for
    the edges that may be false (default: none); ``heavy_tailed (E,)`` True for those that count with a Cauchy
    kernel (default: none); ``world_steps`` an INS's position increments. Raises ``ValueError`` when
    marks are not as many as edges.
    """

    poses: Array
    edges: np.ndarray = field(default_factory=lambda: np.zeros((0, 2), dtype=np.int64))
    T_ij: Array = field(default_factory=lambda: np.zeros((0, 3)))
    information: Array = field(default_factory=lambda: np.zeros((0, 3, 3)))
    loop: np.ndarray = field(default_factory=lambda: np.zeros(0, dtype=bool))
    world_steps: WorldSteps = field(default_factory=WorldSteps)
    heavy_tailed: np.ndarray = field(default_factory=lambda: np.zeros(0, dtype=bool))

    def __post_init__(self) -> None:
        for marks in ("loop", "heavy_tailed"):
            marked = getattr(self, marks)
            if marked.size == len(self.edges):
                continue
            if np.any(marked):
                raise ValueError(
                    f"pose graph: {marks} marks {marked.size} edges, there are {len(self.edges)}"
                )
            object.__setattr__(self, marks, np.zeros(len(self.edges), dtype=bool))

    def with_edges(
        self,
        edges: np.ndarray,
        T_ij: Array,
        information: Array,
        loop: bool = False,
        heavy_tailed: Any = False,
    ) -> PoseGraph:
        """The graph with E further edges, all of them marked alike or by ``heavy_tailed (E,)``."""
        count = len(edges)
        return replace(
            self,
            edges=np.concatenate([self.edges, np.asarray(edges, dtype=np.int64).reshape(-1, 2)]),
            T_ij=np.concatenate([self.T_ij, np.reshape(T_ij, (-1, 3))]),
            information=np.concatenate([self.information, np.reshape(information, (-1, 3, 3))]),
            loop=np.concatenate([self.loop, np.full(count, loop)]),
            heavy_tailed=np.concatenate([self.heavy_tailed, np.full(count, heavy_tailed)]),
        )

    def with_loops(self, edges: np.ndarray, T_ij: Array, information: Array) -> PoseGraph:
        """The graph with further edges that may be false."""
        return self.with_edges(edges, T_ij, information, loop=True)

    def with_only(self, loops: np.ndarray) -> PoseGraph:
        """The graph without the loops for which ``loops (L,)`` bool, in their order, is False."""
        kept = ~self.loop
        kept[np.flatnonzero(self.loop)[loops]] = True
        names = ("edges", "T_ij", "information", "loop", "heavy_tailed")
        return replace(self, **{name: getattr(self, name)[kept] for name in names})


@dataclass(frozen=True)
class Solution:
    """Optimised ``poses (K, 3)`` and the ``weights (L,)`` left to the loop edges in their order (1 kept, 0
    switched off); ``note`` says in a line where they are no better than those that were given.
    """

    poses: Array
    weights: Array
    note: str = ""


def optimise(graph: PoseGraph, loss: Loss = "gnc", gnc: GncConfig = DEFAULT_GNC) -> Solution:
    """Most likely poses of the graph by gtsam's Levenberg-Marquardt, robust against false loops.

    ``gnc``: graduated non-convexity with truncated least squares (Yang et al. 2020) over the loops, all
    other edges known inliers; ``none``: plain least squares. From poses that are `FAR_OFF` the way down is
    long, and may end in a pit or not begin; there it also begins at LAGO's (Carlone et al. 2014), and the
    lower end counts. Parts that no edge connects keep their first pose. An INS's steps are linearised anew up
    to `RELINEARISATIONS` times. Raises ``ValueError`` when an edge's information is not positive
    semi-definite, which gtsam would accept, and when it ends where it begins.
    """
    _refuse(graph.edges, graph.edges[:, 0] == graph.edges[:, 1], "end", "another node")
    _refuse(graph.edges, ~np.all(np.isfinite(graph.information), axis=(1, 2)), "information", "finite")
    lowest = _eigenvalues(graph.information)
    indefinite = lowest[:, 0] < -1e-6 * np.maximum(lowest[:, 2], 1.0)
    _refuse(graph.edges, indefinite, "information", "positive semi-definite")
    poses: Array = graph.poses
    weights: Array = np.ones(int(graph.loop.sum()))
    for _ in range(RELINEARISATIONS):
        before = poses
        poses, weights = _solve(replace(graph, poses=before), loss, gnc)
        change = se2.between(before, poses)
        if len(graph.world_steps) == 0 or np.max(np.abs(change)) < SETTLED:
            break
    first, last = (float(chi_squared(graph, p).sum()) for p in (graph.poses, poses))
    note = ""
    if last >= first > NOTHING and not len(graph.world_steps) and not np.any(graph.loop):
        note = f"the cost did not go down: chi-squared {first:.6g} before, {last:.6g} after"
    return Solution(poses, weights, note)


def informations(edges: np.ndarray, covariance: Array) -> Array:
    """Information ``(E, 3, 3)`` of edges ``(E, 2)`` from their covariances ``(E, 3, 3)``.

    Raises ``ValueError`` naming the first edge whose covariance is not finite or not positive definite.
    """
    covariance = np.reshape(covariance, (-1, 3, 3))
    _refuse(edges, ~np.all(np.isfinite(covariance), axis=(1, 2)), "covariance", "finite")
    lowest = _eigenvalues(covariance)
    _refuse(edges, lowest[:, 0] <= 1e-12 * lowest[:, 2], "covariance", "positive definite")
    return np.linalg.inv(covariance)


def _eigenvalues(matrices: Array) -> Array:
    return np.linalg.eigvalsh(0.5 * (matrices + np.swapaxes(matrices, -1, -2)))


def _refuse(edges: np.ndarray, bad: np.ndarray, what: str, expected: str) -> None:
    if np.any(bad):
        i, j = edges[int(np.argmax(bad))]
        raise ValueError(f"pose graph: the {what} of edge {i}-{j} is not {expected}")


def _solve(graph: PoseGraph, loss: Loss, gnc: GncConfig) -> tuple[Array, Array]:
    """Poses and loop weights, with the INS's steps linearised at the graph's own poses."""
    import gtsam

    factors, initial = to_gtsam(graph)
    loops = np.flatnonzero(graph.loop)
    if loss == "none" or not len(loops):
        solved = _descend(graph, factors, initial)
        return gtsam.utilities.extractPose2(solved), np.ones(len(loops))
    parameters = gtsam.GncLMParams(gtsam.LevenbergMarquardtParams())
    parameters.setLossType(gtsam.GncLossType.TLS)
    parameters.setAllowNonNoiseModelFactors(True)
    doubted = set(loops.tolist())
    parameters.setKnownInliers([f for f in range(factors.size()) if f not in doubted])
    optimizer = gtsam.GncLMOptimizer(factors, initial, parameters)
    optimizer.setInlierCostThresholdsAtProbability(gnc.inlier_probability)
    poses = gtsam.utilities.extractPose2(optimizer.optimize())
    return poses, np.asarray(optimizer.getWeights())[loops]


def _descend(graph: PoseGraph, factors: Any, initial: Any) -> Any:
    """gtsam's values where Levenberg-Marquardt ends, from the given poses or from LAGO's."""
    import gtsam

    values = gtsam.LevenbergMarquardtOptimizer(factors, initial).optimize()
    far_off = not len(graph.world_steps) and len(graph.edges) > 0
    if far_off and np.mean(chi_squared(graph, graph.poses)) / 3.0 > FAR_OFF:
        start = _lago(graph)
        if start is not None:
            other = gtsam.LevenbergMarquardtOptimizer(factors, start).optimize()
            if factors.error(other) < factors.error(values):
                return other
    return values


def _lago(graph: PoseGraph) -> Any:
    """gtsam's values of the poses whose orientations a linear problem gives, which needs no guess; None where
    it has no solution. LAGO takes diagonal noise only."""
    import gtsam

    factors = gtsam.NonlinearFactorGraph()
    precision = np.diagonal(graph.information, axis1=1, axis2=2)
    for (i, j), T, sigmas in zip(
        graph.edges, graph.T_ij, np.maximum(precision, LARGEST_SIGMA**-2) ** -0.5, strict=True
    ):
        noise = gtsam.noiseModel.Diagonal.Sigmas(sigmas)
        factors.add(gtsam.BetweenFactorPose2(int(i), int(j), gtsam.Pose2(*T), noise))
    for k in anchors(graph):
        factors.add(anchor_factor(graph.poses[k], k))
    try:
        return gtsam.lago.initialize(factors)
    except (RuntimeError, ValueError, IndexError):  # what gtsam's exceptions become
        return None


def anchors(graph: PoseGraph) -> list[int]:
    """The first node of every part of the graph that no edge, nor an INS's step, connects with another."""
    told = np.any(graph.information != 0.0, axis=(1, 2))
    edges = np.concatenate([graph.edges[told].reshape(-1, 2), graph.world_steps.edges])
    parts = _parts(len(graph.poses), edges)
    return np.unique(parts, return_index=True)[1].tolist()


def _parts(nodes: int, edges: np.ndarray) -> np.ndarray:
    """Number of the part ``(K,)`` that each node is in."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    i, j = edges.T
    return connected_components(coo_array((np.ones(len(i)), (i, j)), shape=(nodes, nodes)), directed=False)[1]


def spanning_tree_poses(nodes: int, edges: np.ndarray, T_ij: Array) -> Array:
    """Poses ``(K, 3)`` strung together from the first node of every part, along as few edges as possible."""
    neighbours: list[list[tuple[int, Array]]] = [[] for _ in range(nodes)]
    for (i, j), T, T_back in zip(edges.tolist(), T_ij, se2.inverse(T_ij), strict=True):
        neighbours[i].append((j, T))
        neighbours[j].append((i, T_back))
    poses = np.full((nodes, 3), np.nan)
    for root in range(nodes):
        if np.isfinite(poses[root, 0]):
            continue
        poses[root] = 0.0
        queue = deque([root])
        while queue:
            node = queue.popleft()
            for other, T in neighbours[node]:
                if np.isnan(poses[other, 0]):
                    poses[other] = se2.compose(poses[node], T)
                    queue.append(other)
    return poses


def to_gtsam(graph: PoseGraph) -> tuple[Any, Any]:
    """gtsam's ``NonlinearFactorGraph`` and ``Values`` of a graph, loops counting fully.

    Edge e of the graph is factor e; the priors of `anchors` and the INS's steps follow.
    """
    import gtsam

    factors = gtsam.NonlinearFactorGraph()
    for (i, j), T, information, heavy_tailed in zip(
        graph.edges, graph.T_ij, graph.information, graph.heavy_tailed, strict=True
    ):
        factors.add(between_factor(int(i), int(j), T, information, heavy_tailed))
    for k in anchors(graph):
        factors.add(anchor_factor(graph.poses[k], k))
    _add_world_steps(factors, graph.world_steps, graph.poses)
    values = gtsam.Values()
    for k, pose in enumerate(graph.poses):
        values.insert(k, gtsam.Pose2(*pose))
    return factors, values


def between_factor(i: int, j: int, T_ij: Array, information: Array, heavy_tailed: bool) -> Any:
    """gtsam's factor of a relative pose ``(3,)`` with its information ``(3, 3)``, with a Cauchy kernel if
    ``heavy_tailed``."""
    import gtsam

    noise: Any = gtsam.noiseModel.Gaussian.Information(0.5 * (information + information.T))
    if heavy_tailed:
        noise = gtsam.noiseModel.Robust.Create(gtsam.noiseModel.mEstimator.Cauchy.Create(CAUCHY), noise)
    return gtsam.BetweenFactorPose2(i, j, gtsam.Pose2(*T_ij), noise)


def anchor_factor(pose: Array, node: int = 0) -> Any:
    """gtsam's prior that pins a node at ``pose (3,)``."""
    import gtsam

    noise = gtsam.noiseModel.Diagonal.Sigmas(np.array(ANCHOR_SIGMAS))
    return gtsam.PriorFactorPose2(node, gtsam.Pose2(*pose), noise)


def _add_world_steps(factors: Any, steps: WorldSteps, poses: Array) -> None:
    """Rows of ``t_j − t_i − displacement``, linearised at ``poses``: gtsam has no such factor of its own,
    and its GNC cannot clone a CustomFactor."""
    import gtsam

    unit = gtsam.noiseModel.Unit.Create(2)
    turned = se2.rotation(poses[:, 2])
    for (i, j), moved, variance in zip(steps.edges, steps.displacement, steps.variance, strict=True):
        weight = 1.0 / np.sqrt(variance)
        residual = poses[j, :2] - poses[i, :2] - moved
        A_i, A_j = np.zeros((2, 3)), np.zeros((2, 3))
        A_i[:, :2], A_j[:, :2] = -weight * turned[i], weight * turned[j]
        row = gtsam.JacobianFactor(int(i), A_i, int(j), A_j, -weight * residual, unit)
        at = gtsam.Values()
        at.insert(int(i), gtsam.Pose2(*poses[i]))
        at.insert(int(j), gtsam.Pose2(*poses[j]))
        factors.add(gtsam.LinearContainerFactor(row, at))


def chi_squared(graph: PoseGraph, poses: Array) -> Array:
    """Squared normalised residual ``(E,)`` of every edge at ``poses (K, 3)``."""
    i, j = graph.edges.T
    residual = se2.log(se2.between(graph.T_ij, se2.between(poses[i], poses[j])))
    return np.einsum("ea,eab,eb->e", residual, graph.information, residual)
