"""From the best cell of a search to a pose: climbing the score between the cells; how sharp its top is."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import product

import numpy as np

from slam import se2
from slam.se2 import Array
from stitch.alignment.config import AlignConfig
from stitch.alignment.raster import Raster, Walls, rasterise
from stitch.alignment.result import Prior
from stitch.alignment.translation import LINE

MARGIN = 6
"""Cells around a field: the outermost wall is blurred too, and is interpolated on both sides."""
NOTHING = 50.0
"""Temperatures below the best score at which a pose weighs less than rounding does."""


@dataclass(frozen=True)
class ScoreField:
    """The score of `stitch.alignment.translation.Correlation` as a function of the whole pose.

    b's walls ``points_b (n, 2)`` read ``near_a`` (those of ``raster_a``, blurred) and ``free_a``; a's walls
    ``points_a`` read ``free_b``. Fields start at lattice cells ``first_a``, ``first_b``; ``weights_a``,
    ``weights_b`` are those of the points; ``penalty`` per wall in free space.
    """

    raster_a: Raster
    near_a: np.ndarray
    free_a: np.ndarray
    first_a: Array
    points_a: Array
    weights_a: Array
    free_b: np.ndarray
    first_b: Array
    points_b: Array
    weights_b: Array
    penalty: float
    config: AlignConfig
    prior: Prior | None

    @cached_property
    def field_a(self) -> np.ndarray:
        """What a cell of a's lattice is worth to a wall of b."""
        return self.near_a - np.float32(self.penalty) * self.free_a

    @cached_property
    def field_b(self) -> np.ndarray:
        """What a cell of b's lattice is worth to a wall of a."""
        return -np.float32(self.penalty) * self.free_b

    def scores(self, T_a_b: Array, least: float = -np.inf) -> Array:
        """Scores ``(K,)`` of poses ``(K, 3)``, in coinciding cells; -inf for those surely below ``least``."""
        shared = self._over_a(self.field_a, T_a_b)
        shared -= prior_penalty(self.prior, T_a_b, self.config.prior_weight)
        worth = shared >= least
        scores = np.full(len(shared), -np.inf)
        scores[worth] = shared[worth] - self.penalty * self._over_b(T_a_b[worth])
        return scores

    def agreement(self, T_a_b: Array) -> Array:
        """Cells ``(K,)`` of walls that coincide at poses ``(K, 3)``, a straight wall's cell counting 1."""
        return self._over_a(self.near_a, T_a_b) / LINE

    def conflict(self, T_a_b: Array) -> Array:
        """Cells ``(K,)`` of walls of either map that lie in the other's free space at poses ``(K, 3)``."""
        return self._over_a(self.free_a, T_a_b) + self._over_b(T_a_b)

    def _over_a(self, field: np.ndarray, T_a_b: Array) -> Array:
        from stitch.alignment.kernels import sum_along

        return sum_along(field, self.first_a, self.config.resolution, self.points_b, self.weights_b, T_a_b)

    def _over_b(self, T_a_b: Array) -> Array:
        from stitch.alignment.kernels import sum_along

        T_b_a = se2.inverse(T_a_b)
        return sum_along(
            self.free_b, self.first_b, self.config.resolution, self.points_a, self.weights_a, T_b_a
        )


def prior_penalty(prior: Prior | None, T_a_b: Array, weight: float) -> Array | float:
    """Cells ``(...)`` that poses ``(..., 3)`` lose for their distance from the prior."""
    return 0.0 if prior is None else 0.5 * weight * prior.distance(T_a_b)


def score_field(a: Walls, b: Walls, penalty: float, prior: Prior | None, config: AlignConfig) -> ScoreField:
    """The score of moving map b over map a."""
    from scipy.ndimage import gaussian_filter

    raster_a = rasterise(a.points, a.grid, np.zeros(3), config.resolution, a.weights)
    raster_b = rasterise(b.points, b.grid, np.zeros(3), config.resolution)
    near = np.pad(raster_a.walls, MARGIN)
    if config.blur > 0.0:
        sigma = np.sqrt(2.0) * config.blur
        near = np.float32(2.0 * np.pi * sigma**2) * gaussian_filter(near, sigma, mode="constant")
    return ScoreField(
        raster_a=raster_a,
        near_a=near,
        free_a=np.pad(raster_a.free, MARGIN).astype(np.float32),
        first_a=raster_a.first - MARGIN,
        points_a=a.points,
        weights_a=a.weights,
        free_b=np.pad(raster_b.free, MARGIN).astype(np.float32),
        first_b=raster_b.first - MARGIN,
        points_b=b.points,
        weights_b=b.weights,
        penalty=penalty,
        config=config,
        prior=prior,
    )


def about(T_a_b: Array, pivot: Array, steps: Array) -> Array:
    """Poses ``(K, 3)`` near ``T_a_b (3,)``: turned about b's point ``pivot (2,)`` and shifted."""
    T_a_pivot = se2.compose(T_a_b, np.array([*pivot, 0.0]))
    return se2.compose(T_a_pivot + steps, np.array([*-pivot, 0.0]))


def climb(
    field: ScoreField,
    T_a_b: Array,
    pivot: Array,
    step: tuple[float, float] = (0.1, np.radians(1.0)),
    halvings: int = 3,
    stride: int = 1,
) -> tuple[Array, float]:
    """The top of the score near ``T_a_b``, and the score there.

    Steps of ``step`` (m, rad) are halved ``halvings`` times; only every ``stride``-th wall point is read.
    """
    from stitch.alignment.kernels import ascend

    few = slice(None, None, stride)
    expected: Array = np.asarray(T_a_b, dtype=np.float64)
    information: Array = np.zeros((3, 3))
    if field.prior is not None:
        expected = np.asarray(field.prior.T_a_b, dtype=np.float64)
        information = field.config.prior_weight / stride * np.linalg.inv(field.prior.covariance)
    return ascend(
        field.field_a,
        field.first_a,
        np.ascontiguousarray(field.points_a[few]),
        np.ascontiguousarray(field.weights_a[few]),
        field.field_b,
        field.first_b,
        np.ascontiguousarray(field.points_b[few]),
        np.ascontiguousarray(field.weights_b[few]),
        field.config.resolution,
        expected,
        information,
        np.asarray(T_a_b, dtype=np.float64),
        np.asarray(pivot, dtype=np.float64),
        np.array([step[0], step[0], step[1]]),
        halvings,
        10,
    )


def covariance(field: ScoreField, T_a_b: Array, pivot: Array) -> Array:
    """Covariance ``(3, 3)``, right tangent, of the score's top: the neighbourhood weighted by exp(ΔS/T).

    To the spread about ``T_a_b`` come the grid's own rounding and the warp within a submap, both about the
    pivot.
    """
    step = np.array([0.05, 0.05, np.radians(0.5)])
    grid = np.array(list(product(np.arange(-2.0, 3.0), repeat=3)))
    poses = about(T_a_b, pivot, grid * step)
    temperature = field.config.temperature
    scores = field.scores(poses, float(field.scores(T_a_b[None])[0]) - NOTHING * temperature)
    weights = np.exp((scores - scores.max()) / temperature)
    xi = se2.log(se2.between(T_a_b, poses))
    spread = np.einsum("k,ki,kj->ij", weights / weights.sum(), xi, xi)
    shift, turn = field.config.warp
    local = np.diag(step**2 / 12.0 + np.array([shift, shift, turn]) ** 2)
    return spread + se2.transport(local, np.array([*pivot, 0.0]))
