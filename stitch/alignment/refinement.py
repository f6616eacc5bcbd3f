"""From the best cells of a search to a pose and its covariance: the score between the cells."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import product
from typing import NamedTuple

import numpy as np
from numba import njit
from scipy.ndimage import gaussian_filter

from slam import se2
from slam.se2 import Array
from stitch.alignment.config import AlignConfig
from stitch.alignment.raster import Raster, Walls, rasterise
from stitch.alignment.result import Prior
from stitch.alignment.translation import LINE

MARGIN = 6
"""Cells around a field: the outermost wall is blurred too, and is interpolated on both sides."""
NEGLIGIBLE = 50.0
"""Temperatures below the best score at which a pose weighs less than rounding does."""
ONE = np.uint64(1)
"""``index + 1`` with a signed 1 would make numba check for negative indices."""


class Layer(NamedTuple):
    """A field over one map, and the wall points of the other map that read it.

    ``field (H, W)``, whose cell (0, 0) is the lattice cell ``first (2,)``, with cells of ``resolution`` m;
    ``points (n, 2)`` m in the other map's frame, with ``weights (n,)``.
    """

    field: np.ndarray
    first: Array
    resolution: float
    points: Array
    weights: Array


class QuadraticPrior(NamedTuple):
    """Half a squared distance from ``expected (3,)``, in its own axes, by ``information (3, 3)``."""

    expected: Array
    information: Array


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
        shared = sum_along(self.over_a, T_a_b)
        shared -= prior_penalty(self.prior, T_a_b, self.config.prior.weight)
        worth = shared >= least
        scores = np.full(len(shared), -np.inf)
        scores[worth] = shared[worth] - self.penalty * sum_along(self.free_b, se2.inverse(T_a_b[worth]))
        return scores

    def agreement(self, T_a_b: Array) -> Array:
        """Cells ``(K,)`` of walls that coincide at poses ``(K, 3)``, a straight wall's cell counting 1."""
        return sum_along(self.near, T_a_b) / LINE

    def conflict(self, T_a_b: Array) -> Array:
        """Cells ``(K,)`` of walls of either map that lie in the other's free space at poses ``(K, 3)``."""
        return sum_along(self.free_a, T_a_b) + sum_along(self.free_b, se2.inverse(T_a_b))

    def pivot(self, T_a_b: Array) -> Array:
        """Point ``(2,)`` about which b is turned: the mean of its walls that a knows something about."""
        return mean_of_known(_thinned(self.over_a, self.config.climb.stride), T_a_b)


def prior_penalty(prior: Prior | None, T_a_b: Array, weight: float) -> Array | float:
    """Half the squared Mahalanobis distances ``(...)`` of poses ``(..., 3)`` from the prior, weighted."""
    return 0.0 if prior is None else 0.5 * weight * prior.distance(T_a_b)


def score_field(a: Walls, b: Walls, prior: Prior | None, config: AlignConfig) -> ScoreField:
    """The score of moving map b over map a, with a penalty between those of the two searches."""
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
    start: Array = np.asarray(T_a_b, dtype=np.float64)
    prior, climb = QuadraticPrior(start, np.zeros((3, 3))), field.config.climb
    if field.prior is not None:
        information = field.config.prior.weight / stride * np.linalg.inv(field.prior.covariance)
        prior = QuadraticPrior(np.asarray(field.prior.T_a_b, dtype=np.float64), information)
    over_a, over_b = _thinned(field.over_a, stride), _thinned(field.over_b, stride)
    steps = np.array([step[0], step[0], step[1]])
    return climb_to_top(over_a, over_b, prior, start, pivot, steps, climb.halvings, climb.max_steps)


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


@njit(cache=True)
def sum_along(layer: Layer, poses: Array) -> Array:
    """Weighted sums ``(K,)`` of a field (bilinear, zero outside) at the points moved by ``poses (K, 3)``."""
    out = np.zeros(poses.shape[0])
    xy, scratch = layer.points.T.copy(), _scratch(layer.points.shape[0])
    for k in range(poses.shape[0]):
        out[k] = _sum_at(layer, xy, poses[k], scratch)
    return out


@njit(cache=True)
def _scratch(n):
    """Memory that `_sum_at` needs for n points."""
    return np.empty(n, np.int32), np.empty((3, n))


@njit(cache=True)
def _sum_at(layer, xy, pose, scratch):
    """The sum for one pose; ``xy (2, n)`` are the points. Cells are computed first, vectorised, then read."""
    field, first, resolution, _, weights = layer  # as locals: a field read in a loop is not vectorised
    height, width = field.shape
    if height < 2 or width < 2:
        return 0.0
    c, s = np.cos(pose[2]) / resolution, np.sin(pose[2]) / resolution
    x0 = pose[0] / resolution - first[0] - 0.5
    y0 = pose[1] / resolution - first[1] - 0.5
    cells, parts = scratch
    for n in range(xy.shape[1]):
        x = c * xy[0, n] - s * xy[1, n] + x0
        y = s * xy[0, n] + c * xy[1, n] + y0
        inside = (x >= 0.0) & (x < width - 1.0) & (y >= 0.0) & (y < height - 1.0)
        x, y = x if inside else 0.0, y if inside else 0.0
        i, j = np.int32(y), np.int32(x)
        cells[n] = i * np.int32(width) + j
        parts[0, n], parts[1, n] = x - j, y - i
        parts[2, n] = weights[n] if inside else 0.0
    flat, below, total = field.ravel(), np.uint64(width), 0.0
    for n in range(xy.shape[1]):
        if parts[2, n] == 0.0:
            continue
        k, u, v = np.uint64(np.uint32(cells[n])), parts[0, n], parts[1, n]
        low = (1.0 - u) * flat[k] + u * flat[k + ONE]
        high = (1.0 - u) * flat[k + below] + u * flat[k + below + ONE]
        total += parts[2, n] * ((1.0 - v) * low + v * high)
    return total


@njit(cache=True)
def _prior_loss(pose, prior):
    """What a pose ``(3,)`` loses by a `QuadraticPrior`."""
    expected = prior.expected
    c, s = np.cos(expected[2]), np.sin(expected[2])
    dx, dy = pose[0] - expected[0], pose[1] - expected[1]
    turn = (pose[2] - expected[2] + np.pi) % (2.0 * np.pi) - np.pi
    error = (c * dx + s * dy, c * dy - s * dx, turn)
    loss = 0.0
    for i in range(3):
        for j in range(3):
            loss += 0.5 * error[i] * prior.information[i, j] * error[j]
    return loss


@njit(cache=True)
def _contains(places, place):
    """Is ``place (3,)`` one of ``places (k, 3)``?"""
    found = False
    for other in places:
        found |= other[0] == place[0] and other[1] == place[1] and other[2] == place[2]
    return found


@njit(cache=True)
def _pose_from_pivot(T_a_pivot, pivot, pose):
    """Writes the ``pose (3,)`` of b whose point ``pivot (2,)`` lies at ``T_a_pivot (3,)``."""
    c, s = np.cos(T_a_pivot[2]), np.sin(T_a_pivot[2])
    pose[0] = T_a_pivot[0] - c * pivot[0] + s * pivot[1]
    pose[1] = T_a_pivot[1] - s * pivot[0] - c * pivot[1]
    pose[2] = T_a_pivot[2]


@njit(cache=True)
def _invert(pose, inverse):
    """Writes the ``inverse (3,)`` of a pose ``(3,)``."""
    c, s = np.cos(pose[2]), np.sin(pose[2])
    inverse[0], inverse[1], inverse[2] = -c * pose[0] - s * pose[1], s * pose[0] - c * pose[1], -pose[2]


@njit(cache=True)
def climb_to_top(over_a: Layer, over_b: Layer, prior: QuadraticPrior, T_a_b: Array, pivot: Array, step: Array,
               halvings: int, max_steps: int) -> tuple[Array, float]:  # fmt: skip
    """The local maximum of the score near ``T_a_b (3,)``, and the score there.

    Moves to the best of the six neighbours at ``step (3,)`` (m, m, rad) as long as that is better, at most
    ``max_steps`` times; then with half the step, ``halvings`` times. b turns about its point ``pivot (2,)``.

    The score is `sum_along` of ``over_a`` (read by b's points) and of ``over_b`` (read by a's points), less
    the prior's loss. The field of ``over_b`` must be nowhere positive: then a pose that is not better
    without it is not better with it, and it need not be summed.
    """
    step, at, best = step.copy(), T_a_b.copy(), -np.inf
    at[0] += np.cos(T_a_b[2]) * pivot[0] - np.sin(T_a_b[2]) * pivot[1]  # of the pivot
    at[1] += np.sin(T_a_b[2]) * pivot[0] + np.cos(T_a_b[2]) * pivot[1]
    trial, pose, inverse = at.copy(), np.zeros(3), np.zeros(3)
    xy_b, xy_a = over_a.points.T.copy(), over_b.points.T.copy()
    scratch = _scratch(max(len(over_a.points), len(over_b.points)))
    tried, place = np.empty((6 * max_steps + 7, 3), np.int64), np.empty(3, np.int64)
    for _ in range(halvings + 1):
        place[:], tried[0] = 0, 0  # steps from where this round starts
        count = int(best > -np.inf)  # the start itself has not been scored in the first round
        for _ in range(max_steps + 1):
            chosen, chosen_way = -1, 0
            for k in range(6):
                axis, way = k % 3, 1 if k < 3 else -1
                place[axis] += way
                known = _contains(tried[:count], place)  # and not better
                tried[count] = place
                place[axis] -= way
                if known:
                    continue
                count += 1
                trial[:] = at
                trial[axis] += way * step[axis]
                _pose_from_pivot(trial, pivot, pose)
                loss = _prior_loss(pose, prior)
                score = _sum_at(over_a, xy_b, pose, scratch)
                if score - loss <= best:
                    continue
                _invert(pose, inverse)
                score += _sum_at(over_b, xy_a, inverse, scratch)
                if score - loss > best:
                    best, chosen, chosen_way = score - loss, axis, way
            if chosen < 0:
                break
            at[chosen] += chosen_way * step[chosen]
            place[chosen] += chosen_way
        step *= 0.5
    _pose_from_pivot(at, pivot, pose)
    return pose, best


@njit(cache=True)
def mean_of_known(layer: Layer, pose: Array) -> Array:
    """Mean ``(2,)`` of a layer's points that, moved by ``pose (3,)``, lie in cells of its field that are not
    zero; of all of them when none does."""
    c, s = np.cos(pose[2]), np.sin(pose[2])
    known, first, resolution, points, _ = layer
    total, everything = np.zeros(3), np.zeros(2)
    for n in range(points.shape[0]):
        everything += points[n]
        x, y = c * points[n, 0] - s * points[n, 1] + pose[0], s * points[n, 0] + c * points[n, 1] + pose[1]
        j = int(np.floor(x / resolution) - first[0])
        i = int(np.floor(y / resolution) - first[1])
        if 0 <= i < known.shape[0] and 0 <= j < known.shape[1] and known[i, j] != 0.0:
            total[0] += points[n, 0]
            total[1] += points[n, 1]
            total[2] += 1.0
    return total[:2] / total[2] if total[2] > 0.0 else everything / points.shape[0]
