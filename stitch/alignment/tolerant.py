"""Maps that may be bent: a tolerant search, every candidate bent, and acceptance by what is then left."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from slam import se2
from slam.mapping.submap import Submap
from slam.se2 import Array
from stitch.alignment.acceptance import SharedArea, measure_shared_area
from stitch.alignment.bend import Bend, bend, settle
from stitch.alignment.config import AlignConfig, TolerantConfig
from stitch.alignment.facing import FacingWalls, facing_walls
from stitch.alignment.judgement import Judged, judge
from stitch.alignment.raster import rasterise
from stitch.alignment.result import Alternative, NoStitch, Prior, Stitch
from stitch.alignment.tolerant_search import distinct, search

MOST_ALTERNATIVES = 4
"""Further hypotheses that are told: five with the best."""
PIECE = 4.0
"""Side [m] of the pieces of overlap whose deviations tell the covariance."""
RELATED = 4.0
"""So many neighbouring pieces deviate alike: bending is smooth."""
LEAST_DEVIATION = 0.05
"""Standard deviation [m] of a piece at least."""
BELIEF_SCALE = 5.0
"""Metres of margin that make one of log-odds."""
FOLDED = 0.2
"""Least determinant of the Jacobian of a bend that is believed: there a fifth of the area is left."""


def align_tolerant(
    a: Submap, b: Submap, prior: Prior | None, config: AlignConfig, refused: NoStitch
) -> Stitch | NoStitch:
    """The best alignment of two maps that may be bent, if it is accepted; ``refused`` is joint's answer,
    whose best candidate is judged along with the search's."""
    settings = config.tolerant
    walls_a, walls_b = facing_walls(a), facing_walls(b)
    candidates = search(walls_a, walls_b, settings) + ([] if refused.best is None else [refused.best])
    starts = [candidate.T_a_b for candidate in candidates if _near(candidate.T_a_b, prior, config)]
    judged = hypotheses(walls_a, walls_b, starts, settings)
    if not judged:
        return refused
    best, rivals = judged[0], judged[1:]
    shared = shared_area(a, b, best.bend, best.T_a_b, config)
    margin = margin_over(best, rivals, settings)
    alternatives = tuple(
        Alternative(one.T_a_b, one.score, covariance(walls_b, one),
                    (margin_over(one, [best], settings) - settings.min_margin) / BELIEF_SCALE)
        for one in rivals[:MOST_ALTERNATIVES]
    )  # fmt: skip
    belief = (margin - settings.min_margin) / BELIEF_SCALE
    reason = reason_against(best, rivals, shared, config)
    sigma = covariance(walls_b, best)
    if reason is not None:
        both = f"{refused.reason}; as bent maps: {reason}"
        return NoStitch(both, Alternative(best.T_a_b, best.score, sigma, belief), alternatives)
    return Stitch(
        best.T_a_b, sigma, best.score, shared.overlap_area, shared.agreement, alternatives, belief, best.bend
    )


def bend_stitch(a: Submap, b: Submap, stitch: Stitch, config: AlignConfig) -> Stitch | NoStitch:
    """A rigid stitch with the bend that lays b on a; its pose stays. Refused where the bend would fold."""
    walls_a, walls_b = facing_walls(a), facing_walls(b)
    bent = bend(walls_a, walls_b, stitch.T_a_b, config.tolerant)
    least = bent.least_jacobian(walls_b.points)
    if not least > FOLDED:
        return NoStitch(_folds(least), Alternative(stitch.T_a_b, stitch.score))
    return replace(stitch, bend=bent)


def hypotheses(a: FacingWalls, b: FacingWalls, starts: list[Array], config: TolerantConfig) -> list[Judged]:
    """What becomes of poses ``(3,)`` once bent, best first, rivals only."""
    judged = []
    for start in starts:
        T_a_b = settle(a, b, start, config)
        judged.append(judge(a, b, bend(a, b, T_a_b, config), config))
    judged.sort(key=lambda one: -one.rank)
    by_pose = {id(one.T_a_b): one for one in judged}
    kept = distinct([Alternative(one.T_a_b, one.rank) for one in judged], b.middle, config.rival, len(judged))
    return [by_pose[id(one.T_a_b)] for one in kept]


def margin_over(best: Judged, rivals: list[Judged], config: TolerantConfig) -> float:
    """Score ahead of the best rival, in metres of wall, less where much contradicts."""
    rival = max((one.score for one in rivals), default=0.0)
    return (best.score - max(rival, 0.0)) * max(2.0 * best.share - 1.0, 0.0) ** 2


def reason_against(best: Judged, rivals: list[Judged], shared: SharedArea, config: AlignConfig) -> str | None:
    """The first limit that a bent alignment breaks, in words; None when it is believed."""
    limits, settings = config.acceptance, config.tolerant
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
    least = best.bend.least_jacobian(best.bend.knots.reshape(-1, 2))
    return None if least > FOLDED else _folds(least)


def _folds(least: float) -> str:
    return f"the bend would fold: {least:.2g} of the area is left somewhere, expected at least {FOLDED:g}"


def shared_area(a: Submap, b: Submap, bent: Bend, T_a_b: Array, config: AlignConfig) -> SharedArea:
    """What two maps share once b's walls are bent; free space is only moved."""
    walls_a, walls_b = a.grid.occupied_points(), bent.apply(b.grid.occupied_points())
    still = np.zeros(3)
    raster_a = rasterise(walls_a, a.grid, still, config.resolution)
    raster_b = rasterise(se2.transform(se2.inverse(T_a_b), walls_b), b.grid, T_a_b, config.resolution)
    return measure_shared_area(raster_a, raster_b)


def covariance(b: FacingWalls, judged: Judged) -> Array:
    """Covariance ``(3, 3)``, right tangent, of the rigid part: how far the pieces of the overlap deviate from
    it, as many as there are that deviate on their own."""
    bent, T_a_b = judged.bend, judged.T_a_b
    off = se2.transform(se2.inverse(T_a_b), bent.apply(b.points)) - b.points
    pieces = np.floor((b.points - b.middle) / PIECE).astype(np.int64)
    pieces -= pieces.min(axis=0)
    key = pieces[:, 1] * (pieces[:, 0].max() + 1) + pieces[:, 0]
    _, group = np.unique(key, return_inverse=True)
    count = np.bincount(group, judged.agreed).astype(np.float64)
    places = np.stack([np.bincount(group, judged.agreed * b.points[:, axis]) for axis in (0, 1)], -1)
    moved = np.stack([np.bincount(group, judged.agreed * off[:, axis]) for axis in (0, 1)], -1)
    use = count >= min(1.0, count.max())
    places, moved = places[use] / count[use, None], moved[use] / count[use, None]
    variance = LEAST_DEVIATION**2 + float(np.mean(moved**2))
    information = np.zeros((3, 3))
    for x, y in places:
        J = np.array([[1.0, 0.0, -y], [0.0, 1.0, x]])
        information += J.T @ J / variance
    weakest = np.diag([1.0, 1.0, np.radians(10.0) ** -2])
    sigma: Array = np.linalg.inv(information / RELATED + weakest)
    return sigma


def _near(T_a_b: Array, prior: Prior | None, config: AlignConfig) -> bool:
    """Whether a candidate may be meant by the prior, wherever bending takes it."""
    if prior is None:
        return True
    reach = np.diag([config.tolerant.separation[0] ** 2] * 2 + [config.tolerant.separation[1] ** 2])
    return bool(prior.distance(T_a_b.copy(), reach) <= se2.max_distance(config.prior.confidence))
