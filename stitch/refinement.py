"""From the best cell of a search to a pose: climbing the score between the cells; how sharp its top is."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np

from slam import se2
from slam.se2 import Array
from stitch.config import AlignConfig
from stitch.raster import Raster
from stitch.result import Prior

MARGIN = 6
"""Cells around a field: the outermost wall is blurred too, and is interpolated on both sides."""
NEIGHBOURS = np.concatenate([np.eye(3), -np.eye(3)])


@dataclass(frozen=True)
class ScoreField:
    """The score of `stitch.translation.correlate` as a function of the whole pose.

    b's walls ``points_b (n, 2)`` read ``field_a`` (blurred walls less penalised free space) and a's walls
    ``points_a`` read ``field_b`` (penalised free space); fields start at lattice cells ``first_a``,
    ``first_b``.
    """

    field_a: np.ndarray
    first_a: Array
    points_a: Array
    field_b: np.ndarray
    first_b: Array
    points_b: Array
    config: AlignConfig
    prior: Prior | None

    def scores(self, T_a_b: Array) -> Array:
        """Scores ``(K,)`` of poses ``(K, 3)``, in coinciding cells."""
        from stitch.kernels import sum_along

        side = self.config.resolution
        shared = sum_along(self.field_a, self.first_a, side, self.points_b, T_a_b)
        against = sum_along(self.field_b, self.first_b, side, self.points_a, se2.inverse(T_a_b))
        return shared + against - prior_penalty(self.prior, T_a_b, self.config.prior_weight)


def prior_penalty(prior: Prior | None, T_a_b: Array, weight: float) -> Array | float:
    """Cells ``(...)`` that poses ``(..., 3)`` lose for their distance from the prior."""
    return 0.0 if prior is None else 0.5 * weight * prior.distance(T_a_b)


def score_field(
    a: Raster, points_a: Array, b: Raster, points_b: Array, prior: Prior | None, config: AlignConfig
) -> ScoreField:
    """The score of moving raster b over raster a, each in its own frame."""
    from scipy.ndimage import gaussian_filter

    walls = np.pad(a.occupied.astype(np.float32), MARGIN)
    if config.blur > 0.0:
        sigma = np.sqrt(2.0) * config.blur
        walls = np.float32(2.0 * np.pi * sigma**2) * gaussian_filter(walls, sigma, mode="constant")
    penalty = np.float32(config.free_penalty)
    return ScoreField(
        field_a=walls - penalty * np.pad(a.free, MARGIN),
        first_a=a.first - MARGIN,
        points_a=points_a,
        field_b=-penalty * np.pad(b.free, MARGIN),
        first_b=b.first - MARGIN,
        points_b=points_b,
        config=config,
        prior=prior,
    )


def about(T_a_b: Array, pivot: Array, steps: Array) -> Array:
    """Poses ``(K, 3)`` near ``T_a_b (3,)``: turned about b's point ``pivot (2,)`` and shifted."""
    T_a_pivot = se2.compose(T_a_b, np.array([*pivot, 0.0]))
    return se2.compose(T_a_pivot + steps, np.array([*-pivot, 0.0]))


def climb(field: ScoreField, T_a_b: Array, pivot: Array) -> tuple[Array, float]:
    """The top of the score near ``T_a_b``, to 12.5 mm and 0.125°, and the score there."""
    best = float(field.scores(T_a_b[None])[0])
    step = np.array([0.1, 0.1, np.radians(1.0)])
    for _ in range(4):
        for _ in range(10):
            poses = about(T_a_b, pivot, NEIGHBOURS * step)
            scores = field.scores(poses)
            k = int(np.argmax(scores))
            if not scores[k] > best:
                break
            T_a_b, best = poses[k], float(scores[k])
        step = step / 2.0
    return T_a_b, best


def covariance(field: ScoreField, T_a_b: Array, pivot: Array) -> Array:
    """Covariance ``(3, 3)``, right tangent, of the score's top: the neighbourhood weighted by exp(ΔS/T).

    To the spread about ``T_a_b`` come the grid's own rounding and the warp within a submap, both about the
    pivot.
    """
    step = np.array([0.05, 0.05, np.radians(0.5)])
    grid = np.array(list(product(np.arange(-2.0, 3.0), repeat=3)))
    poses = about(T_a_b, pivot, grid * step)
    scores = field.scores(poses)
    weights = np.exp((scores - scores.max()) / field.config.temperature)
    xi = se2.log(se2.between(T_a_b, poses))
    spread = np.einsum("k,ki,kj->ij", weights / weights.sum(), xi, xi)
    shift, turn = field.config.warp
    local = np.diag(step**2 / 12.0 + np.array([shift, shift, turn]) ** 2)
    return spread + se2.transport(local, np.array([*pivot, 0.0]))
