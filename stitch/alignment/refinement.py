"""From the best cells of a search to a pose and its covariance: the score between the cells."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import product
from typing import TYPE_CHECKING

import numpy as np

from slam import se2
from slam.se2 import Array
from stitch.alignment.config import AlignConfig
from stitch.alignment.raster import Raster, Walls, rasterise
from stitch.alignment.result import Prior
from stitch.alignment.translation import LINE

if TYPE_CHECKING:
    from stitch.alignment.score_kernels import Layer

MARGIN = 6
"""Cells around a field: the outermost wall is blurred too, and is interpolated on both sides."""
NEGLIGIBLE = 50.0
"""Temperatures below the best score at which a pose weighs less than rounding does."""


@dataclass(frozen=True)
class ScoreField:
    """The score of `stitch.alignment.translation.Correlation` as a function of the whole pose.

    b's wall points read the blurred walls of a (``near``) and its free space (``free_a``); a's wall points
    read the free space of b (``free_b``). ``penalty`` per wall cell in free space; ``raster_a`` is unblurred.
    """

    raster_a: Raster
    near: Layer
    free_a: Layer
    free_b: Layer
    penalty: float
    config: AlignConfig
    prior: Prior | None

    @cached_property
    def over_a(self) -> Layer:
        """What b's wall points score over a."""
        return self.near._replace(field=self.near.field - np.float32(self.penalty) * self.free_a.field)

    @cached_property
    def over_b(self) -> Layer:
        """What a's wall points score over b."""
        return self.free_b._replace(field=-np.float32(self.penalty) * self.free_b.field)

    def scores(self, T_a_b: Array, least: float = -np.inf) -> Array:
        """Scores ``(K,)`` of poses ``(K, 3)``, in coinciding cells; -inf for those surely below ``least``."""
        shared = _sum_along(self.over_a, T_a_b)
        shared -= prior_penalty(self.prior, T_a_b, self.config.prior.weight)
        worth = shared >= least
        scores = np.full(len(shared), -np.inf)
        scores[worth] = shared[worth] - self.penalty * _sum_along(self.free_b, se2.inverse(T_a_b[worth]))
        return scores

    def agreement(self, T_a_b: Array) -> Array:
        """Cells ``(K,)`` of walls that coincide at poses ``(K, 3)``, a straight wall's cell counting 1."""
        return _sum_along(self.near, T_a_b) / LINE

    def conflict(self, T_a_b: Array) -> Array:
        """Cells ``(K,)`` of walls of either map that lie in the other's free space at poses ``(K, 3)``."""
        return _sum_along(self.free_a, T_a_b) + _sum_along(self.free_b, se2.inverse(T_a_b))

    def pivot(self, T_a_b: Array) -> Array:
        """Point ``(2,)`` about which b is turned: the mean of its walls that a knows something about."""
        from stitch.alignment.score_kernels import mean_of_known

        return mean_of_known(_thinned(self.over_a, self.config.climb.stride), T_a_b)


def prior_penalty(prior: Prior | None, T_a_b: Array, weight: float) -> Array | float:
    """Half the squared Mahalanobis distances ``(...)`` of poses ``(..., 3)`` from the prior, weighted."""
    return 0.0 if prior is None else 0.5 * weight * prior.distance(T_a_b)


def score_field(a: Walls, b: Walls, prior: Prior | None, config: AlignConfig) -> ScoreField:
    """The score of moving map b over map a, with a penalty between those of the two searches."""
    from scipy.ndimage import gaussian_filter

    from stitch.alignment.score_kernels import Layer

    resolution, blur = config.resolution, config.search.blur
    raster_a = rasterise(a.points, a.grid, np.zeros(3), resolution, a.weights)
    raster_b = rasterise(b.points, b.grid, np.zeros(3), resolution)
    near = np.pad(raster_a.walls, MARGIN)
    if blur > 0.0:
        sigma = np.sqrt(2.0) * blur
        near = np.float32(2.0 * np.pi * sigma**2) * gaussian_filter(near, sigma, mode="constant")
    free_a, free_b = (np.pad(raster.free, MARGIN).astype(np.float32) for raster in (raster_a, raster_b))
    over_a = Layer(near, raster_a.first - MARGIN, resolution, b.points, b.weights)
    return ScoreField(
        raster_a=raster_a,
        near=over_a,
        free_a=over_a._replace(field=free_a),
        free_b=Layer(free_b, raster_b.first - MARGIN, resolution, a.points, a.weights),
        penalty=float(np.sqrt(config.search.free_penalty * config.search.lenient_penalty)),
        config=config,
        prior=prior,
    )


def _sum_along(layer: Layer, poses: Array) -> Array:
    from stitch.alignment.score_kernels import sum_along

    return sum_along(layer, poses)


def _thinned(layer: Layer, stride: int) -> Layer:
    """The layer with every ``stride``-th of its points."""
    points, weights = (np.ascontiguousarray(part[::stride]) for part in (layer.points, layer.weights))
    return layer._replace(points=points, weights=weights)


def about(T_a_b: Array, pivot: Array, steps: Array) -> Array:
    """Poses ``(K, 3)`` near ``T_a_b (3,)``: turned about b's point ``pivot (2,)`` and shifted."""
    T_a_pivot = se2.compose(T_a_b, np.array([*pivot, 0.0]))
    return se2.compose(T_a_pivot + steps, np.array([*-pivot, 0.0]))


def hill_climb(
    field: ScoreField, T_a_b: Array, pivot: Array, step: tuple[float, float], stride: int = 1
) -> tuple[Array, float]:
    """The local maximum of the score near ``T_a_b (3,)``, and the score there.

    The first ``step`` (m, rad) is halved; b is turned about its point ``pivot (2,)``; only every
    ``stride``-th wall point is read.
    """
    from stitch.alignment import score_kernels as kernels

    start: Array = np.asarray(T_a_b, dtype=np.float64)
    prior, climb = kernels.QuadraticPrior(start, np.zeros((3, 3))), field.config.climb
    if field.prior is not None:
        information = field.config.prior.weight / stride * np.linalg.inv(field.prior.covariance)
        prior = kernels.QuadraticPrior(np.asarray(field.prior.T_a_b, dtype=np.float64), information)
    over_a, over_b = _thinned(field.over_a, stride), _thinned(field.over_b, stride)
    steps = np.array([step[0], step[0], step[1]])
    return kernels.hill_climb(over_a, over_b, prior, start, pivot, steps, climb.halvings, climb.max_steps)


def covariance(field: ScoreField, T_a_b: Array, pivot: Array) -> Array:
    """Covariance ``(3, 3)``, right tangent, of the score's maximum: its neighbourhood weighted by exp(ΔS/T).

    To the spread about ``T_a_b (3,)`` are added the grid's own rounding and the warp within a submap, both
    about the pivot.
    """
    config = field.config.covariance
    step = np.array([config.step[0], *config.step])
    grid = np.array(list(product(np.arange(-2.0, 3.0), repeat=3)))
    poses = about(T_a_b, pivot, grid * step)
    best = float(field.scores(T_a_b[None])[0])
    scores = field.scores(poses, best - NEGLIGIBLE * config.temperature)
    weights = np.exp((scores - scores.max()) / config.temperature)
    xi = se2.log(se2.between(T_a_b, poses))
    spread = np.einsum("k,ki,kj->ij", weights / weights.sum(), xi, xi)
    local = np.diag(step**2 / 12.0 + np.array([config.warp[0], *config.warp]) ** 2)
    return spread + se2.transport(local, np.array([*pivot, 0.0]))
