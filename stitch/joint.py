"""Our stitching: Hough rotations, joint search with a free-space penalty, climbing, verification."""

from __future__ import annotations

import numpy as np

from slam import se2
from slam.matching import MatchConfig
from slam.se2 import Array
from slam.submap import Submap
from stitch import hough
from stitch.config import AlignConfig
from stitch.raster import rasterise, wall_points
from stitch.refinement import ScoreField, climb, covariance, prior_penalty, score_field
from stitch.result import Alternative, NoStitch, Prior, Stitch
from stitch.rotation import hypotheses
from stitch.translation import Spectra, best_shifts, correlate, padded_shape, spectra
from stitch.verification import measure, reason_against

DISTINCT = (0.5, np.radians(5.0))
"""Alignments nearer than this (m at b's walls, rad) are one peak."""
SHIFTS_PER_ROTATION = 3
RIVAL = 0.5
"""Share of the best score below which a candidate of the search cannot become its rival by climbing."""
REFINE_POINTS = 1000
"""About how many of b's points the scan matcher is given: more cost time and tell it nothing new."""
REFINEMENT = MatchConfig(radii=(0.3, 0.2), mutual=False, least_pairs=30)
PRIOR_MARGIN = (0.5, np.radians(2.0))
"""Added to the search around a prior (m, rad): its covariance says nothing about the grid's cells."""


def align_joint(a: Submap, b: Submap, prior: Prior | None, config: AlignConfig) -> Stitch | NoStitch:
    """The alignment with the best joint score, if it can be believed (see `stitch.align.align`)."""
    walls_a, walls_b = wall_points(a, config.resolution), wall_points(b, config.resolution)
    for name, walls in (("a", walls_a), ("b", walls_b)):
        if len(walls) == 0:
            return NoStitch(f"submap {name} has no occupied cells")
    angles = rotations(walls_a, walls_b, prior, config)
    found = search((a, walls_a), (b, walls_b), angles, prior, config)
    if not found:
        return NoStitch("no alignment scores above zero with enough overlap")
    raster_a, raster_b = (
        rasterise(walls, submap.grid, np.zeros(3), config.resolution)
        for walls, submap in ((walls_a, a), (walls_b, b))
    )
    field = score_field(raster_a, walls_a, raster_b, walls_b, prior, config)
    candidates = _climbed(found, field, walls_b.mean(axis=0), config)
    if not candidates:
        return NoStitch("no alignment scores above zero between the cells", found[0])
    best, *others = candidates
    located = _located(a, b, field, best, config)
    if isinstance(located, NoStitch):
        return located
    T_a_b, sigma = located[0], (located[1] + located[1].T) / 2.0
    evidence = measure(raster_a, rasterise(walls_b, b.grid, T_a_b, config.resolution))
    peak_ratio = others[0].score / best.score if others else None
    reason = reason_against(evidence, peak_ratio, _innovation(prior, T_a_b, sigma), config.acceptance)
    if reason is not None:
        return NoStitch(reason, Alternative(T_a_b, best.score))
    return Stitch(T_a_b, sigma, best.score, evidence.overlap_area, evidence.agreement, tuple(others))


def rotations(walls_a: Array, walls_b: Array, prior: Prior | None, config: AlignConfig) -> Array:
    """Rotations ``(m,)`` rad worth trying: Hough's, or a sweep around the prior where Hough has nothing."""
    spectrum_a, spectrum_b = (
        hough.spectrum(hough.transform(walls, config.n_theta, config.resolution))
        for walls in (walls_a, walls_b)
    )
    angles, _ = hypotheses(spectrum_a, spectrum_b, config.n_peaks)
    if prior is None:
        return angles
    yaw = prior.T_a_b[2]
    reach = config.prior_sigmas * np.sqrt(prior.covariance[2, 2]) + PRIOR_MARGIN[1]
    angles = angles[np.abs(se2.wrap(angles - yaw)) <= reach]
    if len(angles) and hough.gridness(spectrum_a).trustworthy and hough.gridness(spectrum_b).trustworthy:
        return angles
    count = int(np.ceil(min(reach, config.sweep_limit) / config.sweep_step))
    return np.concatenate([angles, se2.wrap(yaw + config.sweep_step * np.arange(-count, count + 1))])


def search(
    a: tuple[Submap, Array], b: tuple[Submap, Array], angles: Array, prior: Prior | None, config: AlignConfig
) -> list[Alternative]:
    """The best shifts of all rotations, best first; each map comes with its wall points."""
    resolution = config.search_resolution
    raster_a = rasterise(a[1], a[0].grid, np.zeros(3), resolution)
    turned = [rasterise(b[1], b[0].grid, np.array([0.0, 0.0, angle]), resolution) for angle in angles]
    shape = padded_shape(raster_a, max(max(raster.occupied.shape) for raster in turned))
    spectra_a = spectra(raster_a, shape)
    found = []
    for angle, raster_b in zip(angles, turned, strict=True):
        found += _shifts(spectra_a, spectra(raster_b, shape), angle, prior, config)
    return sorted(found, key=lambda candidate: -candidate.score)


def _shifts(
    a: Spectra, b: Spectra, angle: float, prior: Prior | None, config: AlignConfig
) -> list[Alternative]:
    """The best shifts of one rotation that overlap enough."""
    window = None if prior is None else _window(prior, config)
    correlation = correlate(a, b, config.free_penalty, config.blur, window)
    score = np.where(correlation.overlap >= config.acceptance.min_overlap, correlation.score, -np.inf)
    if prior is not None and score.size:
        poses = np.concatenate([correlation.translations(), np.full((*score.shape, 1), angle)], -1)
        score = score - prior_penalty(prior, poses, config.prior_weight)
    separation = int(DISTINCT[0] / correlation.resolution)
    return [
        Alternative(
            np.array([*(correlation.first + correlation.resolution * np.array([column, row])), angle]),
            float(score[row, column]),
        )
        for row, column in best_shifts(score, SHIFTS_PER_ROTATION, separation)
    ]


def _window(prior: Prior, config: AlignConfig) -> tuple[Array, Array]:
    """Corners of the box (axes of a) that holds the prior's ``prior_sigmas``."""
    R = se2.rotation(prior.T_a_b[2])
    deviation = np.sqrt(np.diag(R @ prior.covariance[:2, :2] @ R.T))
    reach = config.prior_sigmas * deviation + PRIOR_MARGIN[0]
    return prior.T_a_b[:2] - reach, prior.T_a_b[:2] + reach


def _climbed(
    found: list[Alternative], field: ScoreField, centre: Array, config: AlignConfig
) -> list[Alternative]:
    """The best distinct candidates after climbing, best first."""
    tops: list[Alternative] = []
    for rank, candidate in enumerate(_distinct(found, centre)[: config.candidates]):
        if rank >= 2 and candidate.score < RIVAL * found[0].score:
            break
        tops.append(Alternative(*climb(field, candidate.T_a_b, _pivot(field, candidate.T_a_b))))
    tops = sorted((top for top in tops if top.score > 0.0), key=lambda top: -top.score)
    return _distinct(tops, centre)


def _distinct(candidates: list[Alternative], centre: Array) -> list[Alternative]:
    """Candidates, best first, without those that share a better one's peak; measured at b's ``centre``."""
    poses = np.array([candidate.T_a_b for candidate in candidates]).reshape(-1, 3)
    centres = se2.transform(poses, centre[None])[:, 0]
    kept: list[int] = []
    for i in range(len(candidates)):
        far = np.linalg.norm(centres[kept] - centres[i], axis=1) > DISTINCT[0]
        turned = np.abs(se2.wrap(poses[kept, 2] - poses[i, 2])) > DISTINCT[1]
        if np.all(far | turned):
            kept.append(i)
    return [candidates[i] for i in kept]


def _pivot(field: ScoreField, T_a_b: Array) -> Array:
    """Where b is held while it turns: the middle of its walls that a knows something about."""
    cells = np.floor(se2.transform(T_a_b, field.points_b) / field.config.resolution - field.first_a).astype(
        int
    )
    inside = np.all((cells >= 0) & (cells < field.field_a.shape[::-1]), axis=1)
    inside[inside] = field.field_a[cells[inside, 1], cells[inside, 0]] != 0.0
    return field.points_b[inside].mean(axis=0) if inside.any() else field.points_b.mean(axis=0)


def _located(
    a: Submap, b: Submap, field: ScoreField, best: Alternative, config: AlignConfig
) -> tuple[Array, Array] | NoStitch:
    """Pose ``(3,)`` and covariance ``(3, 3)`` of the best candidate, after the scan matcher if asked for."""
    pivot = _pivot(field, best.T_a_b)
    sigma = covariance(field, best.T_a_b, pivot)
    if not config.refine:
        return best.T_a_b, sigma
    from slam.matching import NoMatch, match

    some = b.points.selected(np.arange(0, len(b.points), 1 + len(b.points) // REFINE_POINTS))
    answer = match(a.points, some, best.T_a_b, "plicp", config=REFINEMENT)
    if isinstance(answer, NoMatch):
        return NoStitch(f"the scan matcher found nothing: {answer.reason}", best)
    T_a_b = answer.T_reference_scan
    moved = np.linalg.norm(se2.transform(T_a_b, pivot[None]) - se2.transform(best.T_a_b, pivot[None]))
    turned = abs(float(se2.wrap(T_a_b[2] - best.T_a_b[2])))
    if moved > config.refine_limit[0] or turned > config.refine_limit[1]:
        return NoStitch(f"the scan matcher left the peak by {moved:.2f} m and {turned:.3f} rad", best)
    return T_a_b, sigma + answer.covariance


def _innovation(prior: Prior | None, T_a_b: Array, sigma: Array) -> float | None:
    """Squared Mahalanobis distance of a pose from the prior, both uncertain; None without a prior."""
    if prior is None:
        return None
    error = se2.log(se2.between(prior.T_a_b, T_a_b))
    return float(error @ np.linalg.solve(prior.covariance + sigma, error))
