"""Maps that may be bent: a tolerant search, every candidate bent, and acceptance by what is then left."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from slam import se2
from slam.mapping.submap import Submap
from slam.se2 import Array
from stitch.alignment.acceptance import SharedArea, measure_shared_area
from stitch.alignment.bend import Bend, bend, settle
from stitch.alignment.candidates import distinct
from stitch.alignment.config import AlignConfig, TolerantConfig
from stitch.alignment.facing import FacingWalls, facing_walls
from stitch.alignment.judgement import Judged, judge
from stitch.alignment.raster import rasterise
from stitch.alignment.result import Alternative, NoStitch, Prior, Stitch
from stitch.alignment.tolerant_search import search


def align_tolerant(
    a: Submap, b: Submap, prior: Prior | None, config: AlignConfig, refused: NoStitch
) -> Stitch | NoStitch:
    """The best alignment of two maps that may be bent, if it is accepted; ``refused`` is joint's answer,
    whose best candidate is judged along with the search's."""
    settings = config.tolerant
    if not settings.free_scale and not (a.grid.free.any() and b.grid.free.any()):
        return refused  # nothing could speak against any bend
    walls_a = facing_walls(a, settings.unknown_weight)
    judged: list[Judged] = []
    for scale in scales(settings):
        walls_b = enlarged_walls(b, scale, settings)
        candidates = search(walls_a, walls_b, settings) + ([] if refused.best is None else [refused.best])
        starts = [candidate.T_a_b for candidate in candidates if _near(candidate.T_a_b, prior, config)]
        bent = bend_all(walls_a, walls_b, scale, starts, settings)
        judged += [one for one in bent if _near(one.T_a_b, prior, config)]
    judged = hypotheses(judged, b, settings)
    if not judged:
        return refused
    if settings.free_scale:
        judged = hypotheses([*judged, *refine_scale(walls_a, b, judged[0], settings)], b, settings)
    best, *alternatives = (
        _alternative(one, [other for other in judged if other is not one], settings)
        for one in judged[: 1 + settings.alternatives]
    )
    shared = shared_area(a, scaled(b, best.scale), judged[0].bend, best.T_a_b, config)
    reason = reason_against(judged[0], judged[1:], shared, config)
    if reason is not None:
        return NoStitch(f"{refused.reason}; as bent maps: {reason}", best, tuple(alternatives))
    return Stitch(
        best.T_a_b,
        best.covariance,
        best.score,
        shared.overlap_area,
        shared.agreement,
        tuple(alternatives),
        best.belief,
        best.bend,
        best.scale,
    )


def _alternative(one: Judged, others: list[Judged], config: TolerantConfig) -> Alternative:
    """A hypothesis with its covariance and its belief against the others: 0 at the least that is accepted."""
    belief = (margin_over(one, others, config) - config.min_margin) / config.belief_scale
    return Alternative(one.T_a_b, one.score, covariance(one, config), belief, one.bend, one.scale)


def scales(config: TolerantConfig) -> Array:
    """The scales ``(m,)`` of b that are tried."""
    if not config.free_scale:
        return np.ones(1)
    most = config.max_scale
    return np.linspace(1.0 - most, 1.0 + most, 2 * round(most / config.scale_step) + 1)


def enlarged_walls(b: Submap, scale: float, config: TolerantConfig) -> FacingWalls:
    """The walls of b enlarged, which weigh as much as before: or the largest would always win."""
    walls = facing_walls(scaled(b, scale), config.unknown_weight)
    return walls if scale == 1.0 else replace(walls, weights=walls.weights / scale)


def refine_scale(a: FacingWalls, b: Submap, best: Judged, config: TolerantConfig) -> list[Judged]:
    """The best bend once more, at the scale that takes most of its bending away."""
    judged = []
    for _ in range(config.scale_rounds):
        p = best.walls.points - np.average(best.walls.points, axis=0, weights=best.agreed + 1e-9)
        q = best.bend.apply(best.walls.points)
        q = (q - np.average(q, axis=0, weights=best.agreed + 1e-9)) @ se2.rotation(best.T_a_b[2])
        grown = float(best.agreed @ np.sum(p * q, axis=1) / max(best.agreed @ np.sum(p * p, axis=1), 1e-9))
        scale = best.scale * float(np.clip(grown, 1.0 - config.scale_step, 1.0 + config.scale_step))
        walls = enlarged_walls(b, scale, config)
        place, yaw = se2.transform(best.T_a_b, best.walls.middle[None])[0], best.T_a_b[2]
        start = np.array([*(place - se2.rotation(yaw) @ walls.middle), yaw])
        best = bend_all(a, walls, scale, [start], config)[0]
        judged.append(best)
    return judged


def scaled(submap: Submap, scale: float) -> Submap:
    """A submap enlarged about its anchor."""
    if scale == 1.0:
        return submap
    grid, points = submap.grid, submap.points
    return replace(
        submap,
        points=replace(points, points=scale * points.points),
        grid=replace(grid, origin=scale * grid.origin, resolution=scale * grid.resolution),
    )


def bend_stitch(a: Submap, b: Submap, stitch: Stitch, config: AlignConfig) -> Stitch | NoStitch:
    """A rigid stitch with the bend that lays b on a; its pose stays. Refused where the bend would fold."""
    settings = config.tolerant
    walls_a, walls_b = (facing_walls(submap, settings.unknown_weight) for submap in (a, b))
    bent = bend(walls_a, walls_b, stitch.T_a_b, settings)
    reason = reason_it_folds(bent, walls_b, settings)
    if reason is not None:
        return NoStitch(reason, Alternative(stitch.T_a_b, stitch.score))
    return replace(stitch, bend=bent)


def bend_all(
    a: FacingWalls, b: FacingWalls, scale: float, starts: list[Array], config: TolerantConfig
) -> list[Judged]:
    """What becomes of poses ``(3,)`` of b, enlarged by ``scale``, once bent."""
    return [judge(a, b, bend(a, b, settle(a, b, start, config), config), scale, config) for start in starts]


def hypotheses(judged: list[Judged], b: Submap, config: TolerantConfig) -> list[Judged]:
    """The bent alignments, best first, without those that are near a better one."""
    judged = sorted(judged, key=lambda one: -one.rank)
    middle = b.points.points.mean(axis=0)
    places = [[*se2.transform(one.T_a_b, one.scale * middle[None])[0], one.T_a_b[2]] for one in judged]
    return [judged[k] for k in distinct(np.reshape(places, (-1, 3)), np.zeros(2), config.rival)]


def margin_over(best: Judged, rivals: list[Judged], config: TolerantConfig) -> float:
    """Score ahead of the best rival, in metres of wall, less where much contradicts."""
    rival = max((one.score for one in rivals), default=0.0)
    return (best.score - max(rival, 0.0)) * max(2.0 * best.share - 1.0, 0.0) ** 2


def reason_against(best: Judged, rivals: list[Judged], shared: SharedArea, config: AlignConfig) -> str | None:
    """The first limit that a bent alignment breaks, in words; None when it is believed."""
    limits, settings = config.acceptance, config.tolerant
    if abs(best.scale - 1.0) > settings.max_scale:
        return f"scale {best.scale:.3g}, expected within {settings.max_scale:.0%} of 1"
    for name, value, limit in (
        ("overlap", shared.overlap_area, limits.min_overlap),
        ("space free in both", shared.open_area, limits.min_open),
    ):
        if not value >= limit:
            return f"{name} {value:.3g} m², expected at least {limit:.3g} m²"
    rival = max((one.score for one in rivals), default=0.0)
    if not rival <= settings.max_ambiguity * best.score:
        return (
            f"ambiguity: a rival has {rival:.3g} m of wall for it where the best has {best.score:.3g}, "
            f"expected at most {settings.max_ambiguity:.3g} of that"
        )
    margin = margin_over(best, rivals, settings)
    if not margin >= settings.min_margin:
        return (
            f"margin {margin:.3g} m of wall, expected at least {settings.min_margin:.3g} "
            f"({best.agreement:.3g} m agree, {best.conflict:.3g} m contradict)"
        )
    return reason_it_folds(best.bend, best.walls, settings)


def reason_it_folds(bent: Bend, walls: FacingWalls, config: TolerantConfig) -> str | None:
    """Why a bend of some walls is none, where it folds at them or at its knots; None where it does not."""
    least = bent.least_jacobian(np.concatenate([walls.points, bent.knots.reshape(-1, 2)]))
    if least > config.min_jacobian:
        return None
    expected = f"expected at least {config.min_jacobian:g}"
    return f"the bend would fold: {least:.2g} of the area is left somewhere, {expected}"


def shared_area(a: Submap, b: Submap, bent: Bend, T_a_b: Array, config: AlignConfig) -> SharedArea:
    """What two maps share once b's walls are bent; free space is only moved."""
    walls_a, walls_b = a.grid.occupied_points(), bent.apply(b.grid.occupied_points())
    still = np.zeros(3)
    raster_a = rasterise(walls_a, a.grid, still, config.resolution)
    raster_b = rasterise(se2.transform(se2.inverse(T_a_b), walls_b), b.grid, T_a_b, config.resolution)
    return measure_shared_area(raster_a, raster_b)


def covariance(judged: Judged, config: TolerantConfig) -> Array | None:
    """Covariance ``(3, 3)``, right tangent, of the rigid part: how far the pieces of the overlap deviate from
    it, as many as there are that deviate on their own. None where nothing agrees."""
    bent, T_a_b, b = judged.bend, judged.T_a_b, judged.walls
    off = se2.transform(se2.inverse(T_a_b), bent.apply(b.points)) - b.points
    pieces = np.floor((b.points - b.middle) / config.piece).astype(np.int64)
    _, group = np.unique(pieces, axis=0, return_inverse=True)
    group = group.ravel()
    agreed = np.bincount(group, judged.agreed)
    if not agreed.max() > 0.0:
        return None
    seen = agreed >= min(1.0, agreed.max())

    def means(values: Array) -> Array:
        """Of ``(n, 2)`` by piece ``(p, 2)``, weighed by what agrees."""
        sums = np.stack([np.bincount(group, judged.agreed * column) for column in values.T], -1)
        return sums[seen] / agreed[seen, None]

    (x, y), moved = means(b.points).T, means(off)
    one, none = np.ones_like(x), np.zeros_like(x)
    J = np.stack([np.stack([one, none, -y], -1), np.stack([none, one, x], -1)], axis=1)
    variance = config.related_pieces * (config.piece_sigma**2 + float(np.mean(moved**2)))
    shift, turn = config.max_sigma
    information = np.einsum("pij,pik->jk", J, J) / variance + np.diag(np.array([shift, shift, turn]) ** -2.0)
    sigma: Array = np.linalg.inv(information)
    return sigma


def _near(T_a_b: Array, prior: Prior | None, config: AlignConfig) -> bool:
    """Whether an alignment may be meant by the prior, which knows nothing of bends."""
    if prior is None:
        return True
    reach = np.diag([config.tolerant.separation[0] ** 2] * 2 + [config.tolerant.separation[1] ** 2])
    return bool(prior.distance(T_a_b, reach) <= se2.max_distance(config.prior.confidence))
