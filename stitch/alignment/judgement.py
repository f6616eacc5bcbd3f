"""How well a bent map lies on another, both ways: walls that agree, walls deep in the other's free space."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from slam import se2
from slam.se2 import Array
from stitch.alignment.bend import Bend, apply_lattice, of_walls, pair_with
from stitch.alignment.config import TolerantConfig
from stitch.alignment.facing import CELL, FacingWalls


@dataclass(frozen=True)
class Judged:
    """A bent alignment of b's ``walls``, which were enlarged by ``scale``.

    Its ``bend``, the rigid ``T_a_b (3,)`` nearest to it, metres of wall that agree and that contradict, both
    ways, the bending ``energy``, the ``score``, and the metres ``agreed (n,)`` of each of b's points.
    """

    walls: FacingWalls
    scale: float
    bend: Bend
    T_a_b: Array
    agreement: float
    conflict: float
    energy: float
    score: float
    agreed: Array

    @property
    def share(self) -> float:
        """Of the walls that agree or contradict those that agree."""
        return self.agreement / max(self.agreement + self.conflict, 1e-9)

    @property
    def rank(self) -> float:
        """Score times share."""
        return self.score * self.share


def judge(a: FacingWalls, b: FacingWalls, bent: Bend, scale: float, config: TolerantConfig) -> Judged:
    """What speaks for a bend and against it."""
    placed = apply_lattice(bent.nodes, bent.first, bent.spacing, b.points)
    agree_b, against_b = meet(
        placed[:, :2], b.angles + placed[:, 2], b.known, b.weights, config.judged_width, *of_walls(a),
        a.distance, a.free,
    )  # fmt: skip
    weights = np.maximum(agree_b, 1e-6 * b.weights)
    T_a_b = se2.fit_rigid(b.points, placed[:, :2], weights)
    back = bent.undo(a.points, T_a_b)
    turned = apply_lattice(bent.nodes, bent.first, bent.spacing, back)[:, 2]
    agree_a, against_a = meet(
        back, a.angles - turned, a.known, a.weights, config.judged_width, *of_walls(b), b.distance, b.free
    )
    agreement = float(agree_a.sum() + agree_b.sum())
    conflict = float(against_a.sum() + against_b.sum())
    energy = bent.energy(config)
    score = agreement - config.judged_conflict * conflict - config.stiffness * energy
    return Judged(b, scale, bent, T_a_b, agreement, conflict, energy, score, agree_b)


@njit(cache=True)
def meet(
    placed, facing, known, walls, width, points, angles, known_a, nearest, corner, distance, free
):  # fmt: skip
    """What wall points ``placed (n, 2)`` m that face ``facing (n,)`` rad meet in another map: metres that
    agree ``(n,)`` and that stand deep in free space ``(n,)``."""
    agree, against = np.zeros(len(placed)), np.zeros(len(placed))
    for p in range(len(placed)):
        x, y = placed[p]
        agree[p] = pair_with(x, y, facing[p], known[p], walls[p], width, points, angles, nearest, corner)[1]
        j, i = int(np.floor((x - corner[0]) / CELL)), int(np.floor((y - corner[1]) / CELL))
        if 0 <= i < free.shape[0] and 0 <= j < free.shape[1] and free[i, j]:
            against[p] = walls[p] * min(max((distance[i, j] - width) / width, 0.0), 1.0)
    return agree, against
