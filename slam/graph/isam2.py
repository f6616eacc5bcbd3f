"""A pose graph that grows with the drive, solved incrementally by gtsam's iSAM2 (Kaess et al. 2012)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from slam import se2
from slam.graph.pose_graph import anchor_factor, between_factor
from slam.se2 import Array


class IncrementalGraph:
    """Poses that are added one by one, and relative poses between them that may be taken away again.

    What is added counts from the next `update` on. Node 0 is pinned at ``first (3,)``; a pose that moved by
    ``relinearise`` (m, rad) since it was linearised is linearised anew.
    """

    def __init__(self, first: Array, relinearise: float = 0.05) -> None:
        import gtsam

        parameters = gtsam.ISAM2Params()
        parameters.setRelinearizeThreshold(relinearise)
        parameters.relinearizeSkip = 1
        parameters.enablePartialRelinearizationCheck = True
        self._isam = gtsam.ISAM2(parameters)
        self._count, self._edges = 0, 0
        self._slots: dict[int, int] = {}  # edge -> index of its factor in iSAM2
        self._clear_pending()
        self.add_node(first)
        self._add(anchor_factor(first))
        self.update()

    def add_node(self, guess: Array) -> int:
        """A new node near ``guess (3,)``; returns its index. It needs an edge before the next `update`."""
        import gtsam

        self._values.insert(self._count, gtsam.Pose2(*guess))
        self._guesses.append(np.asarray(guess, dtype=np.float64))
        self._count += 1
        return self._count - 1

    def add_edge(self, i: int, j: int, T_ij: Array, information: Array, heavy_tailed: bool = False) -> int:
        """Relative pose ``T_ij (3,)`` with ``information (3, 3)`` in the tangent of j, singular where it
        says nothing; with a Cauchy kernel if ``heavy_tailed``. Returns the edge's number for `remove`."""
        return self._add(between_factor(int(i), int(j), T_ij, information, heavy_tailed))

    def add_world_step(self, i: int, j: int, displacement: Array, variance: float) -> int:
        """An INS's position increment in its world frame: ``t_j − t_i = displacement (2,)``, whatever the yaw
        is, with ``variance`` m² per axis."""
        import gtsam

        def error(_: Any, values: Any, jacobians: Any) -> Array:
            a, b = values.atPose2(i), values.atPose2(j)
            if jacobians is not None:
                jacobians[0] = np.hstack([-se2.rotation(a.theta()), np.zeros((2, 1))])
                jacobians[1] = np.hstack([se2.rotation(b.theta()), np.zeros((2, 1))])
            return np.array([b.x() - a.x() - displacement[0], b.y() - a.y() - displacement[1]])

        noise = gtsam.noiseModel.Isotropic.Variance(2, variance)
        return self._add(gtsam.CustomFactor(noise, [i, j], error))  # type: ignore[arg-type]  # its own array type

    def remove(self, edges: Sequence[int]) -> None:
        """Take edges away that an `update` has already seen."""
        self._removed += [self._slots.pop(edge) for edge in edges]

    def update(self, rounds: int = 1) -> None:
        """Solve with what was added and removed; more ``rounds`` converge after a loop that moves much."""
        if not self._waiting and not self._removed and rounds == 1:
            return
        result = self._isam.update(self._factors, self._values, self._removed)
        self._slots |= dict(zip(self._waiting, result.getNewFactorsIndices(), strict=True))
        self._clear_pending()
        for _ in range(rounds - 1):
            self._isam.update()

    def pose(self, k: int) -> Array:
        """Node k ``(3,)`` as of the last `update`, or its guess if there was none since it came."""
        known = self._count - len(self._guesses)
        if k >= known:
            return self._guesses[k - known]
        pose = self._isam.calculateEstimatePose2(k)
        return np.array([pose.x(), pose.y(), pose.theta()])

    def poses(self) -> Array:
        """All nodes ``(K, 3)``, each as `pose` has it."""
        import gtsam

        known = gtsam.utilities.extractPose2(self._isam.calculateEstimate())
        return np.concatenate([known.reshape(-1, 3), np.reshape(self._guesses, (-1, 3))])

    def marginals(self) -> Array:
        """Covariances ``(K, 3, 3)`` of the nodes in their body frames."""
        return np.array([self.marginal(k) for k in range(self._count)])

    def marginal(self, k: int) -> Array:
        """Covariance ``(3, 3)`` of node k in its body frame, as of the last `update`."""
        return np.asarray(self._isam.marginalCovariance(k))

    def relative_covariance(self, a: int, b: int) -> Array:
        """Covariance ``(3, 3)`` of the pose of node b seen from node a, in the tangent of b."""
        joint = self._isam.jointMarginalCovariance([a, b])
        moves = np.hstack([-se2.adjoint(se2.between(self.pose(b), self.pose(a))), np.eye(3)])
        blocks = np.block([[joint.at(a, a), joint.at(a, b)], [joint.at(b, a), joint.at(b, b)]])
        return np.asarray(moves @ blocks @ moves.T)

    def _add(self, factor: Any) -> int:
        self._factors.add(factor)
        self._waiting.append(self._edges)
        self._edges += 1
        return self._edges - 1

    def _clear_pending(self) -> None:
        """Nothing waits for the next update."""
        import gtsam

        self._factors, self._values = gtsam.NonlinearFactorGraph(), gtsam.Values()
        self._guesses: list[Array] = []
        self._waiting: list[int] = []
        self._removed: list[int] = []
