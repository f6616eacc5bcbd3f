"""Our aligner: Hough rotations, a search of all shifts, a climb, and acceptance by what the walls meet."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from slam import se2
from slam.mapping.submap import Submap
from slam.matching import NoMatch, Reference, match
from slam.se2 import Array
from stitch.alignment import acceptance, hough, translation
from stitch.alignment.candidates import distinct
from stitch.alignment.config import AlignConfig, SearchConfig
from stitch.alignment.likelihood import PRIOR_BONUS, FreeSpaceMap, count_overlap, overlap_log_odds
from stitch.alignment.raster import Walls, rasterise, walls_of
from stitch.alignment.refinement import ScoreField, covariance, hill_climb, prior_penalty, score_field
from stitch.alignment.result import Alternative, NoStitch, Prior, Stitch

LATTICE_CELL, LATTICE_SIDE = 0.1, 512
"""Cells [m] of the lattice that finds a submap's points, and how many along a side: it repeats itself every
51 m, not every 13 m as a scan's. Changes no result."""


@dataclass(frozen=True)
class AlignmentProblem:
    """Two maps and a prior, prepared so that alignments can be scored."""

    a: FreeSpaceMap
    b: FreeSpaceMap
    field: ScoreField

    @classmethod
    def of(cls, a: Walls, b: Walls, prior: Prior | None, config: AlignConfig) -> AlignmentProblem:
        """The problem of aligning two maps' walls."""
        return cls(FreeSpaceMap.of(a), FreeSpaceMap.of(b), score_field(a, b, prior, config))

    def log_odds(self, T_a_b: Array) -> float:
        """Log-odds of an alignment: its overlap likelihood, with the prior's penalty where there is one."""
        log_odds = overlap_log_odds(count_overlap(self.a, self.b, T_a_b))
        if self.field.prior is None:
            return log_odds
        return log_odds + PRIOR_BONUS - float(prior_penalty(self.field.prior, T_a_b, 1.0))

    def ranked(self, poses: list[Array]) -> list[Alternative]:
        """Poses ``(3,)`` with their log-odds, the likeliest first."""
        candidates = [Alternative(T_a_b, self.log_odds(T_a_b)) for T_a_b in poses]
        return sorted(candidates, key=lambda candidate: -candidate.score)


def align_joint(a: Submap, b: Submap, prior: Prior | None, config: AlignConfig) -> Stitch | NoStitch:
    """The likeliest alignment, if it is accepted (see `stitch.align.align`)."""
    walls_a, walls_b = (walls_of(submap, config.resolution, config.walls) for submap in (a, b))
    for name, walls in (("a", walls_a), ("b", walls_b)):
        if len(walls.points) == 0:
            return NoStitch(f"submap {name} has no occupied cells")
    problem = AlignmentProblem.of(walls_a, walls_b, prior, config)
    candidates = best_candidates(problem)
    if not candidates:
        return NoStitch("the prior leaves no alignment at which the maps touch")
    best, *others = candidates
    shared, scores = score_best(problem, candidates)
    classifier = acceptance.AcceptanceClassifier.learnt()
    belief = float(classifier.log_odds(acceptance.features(shared, scores)))
    reason = acceptance.reason_against(shared, scores, belief, config.acceptance)
    if reason is not None:
        return NoStitch(reason, best)
    located = _located(a, b, problem.field, best)
    if isinstance(located, NoStitch):
        return located
    T_a_b, sigma = located[0], (located[1] + located[1].T) / 2.0
    if prior is not None:
        distance, limit = float(prior.distance(T_a_b, sigma)), se2.max_distance(config.prior.confidence)
        if not distance <= limit:
            reason = f"distance from the prior {distance:.3g}, expected at most {limit:.3g}"
            return NoStitch(reason, Alternative(T_a_b, best.score))
    return Stitch(T_a_b, sigma, best.score, shared.overlap_area, shared.agreement, tuple(others), belief)


def best_candidates(problem: AlignmentProblem) -> list[Alternative]:
    """Distinct alignments with their log-odds, the likeliest first.

    All that a search of all rotations and shifts finds climb coarsely, with a part of the points; the
    likeliest climb on finely.
    """
    a, b, field = problem.a.walls, problem.b.walls, problem.field
    config, prior, centre = field.config, field.prior, b.points.mean(axis=0)
    climb, angles = config.climb, rotations(a.points, b.points, prior, config)
    # many are found with either penalty
    starts = {tuple(c.T_a_b): c.T_a_b for c in search(a, b, angles, prior, config)}.values()
    coarse = [hill_climb(field, T, field.pivot(T), climb.coarse_step, climb.stride)[0] for T in starts]
    finalists = _distinct(problem.ranked(coarse), centre, config.search)[: climb.finalists]
    fine = [hill_climb(field, c.T_a_b, field.pivot(c.T_a_b), climb.fine_step)[0] for c in finalists]
    return _distinct(problem.ranked(fine), centre, config.search)


def rotations(walls_a: Array, walls_b: Array, prior: Prior | None, config: AlignConfig) -> Array:
    """Rotations ``(m,)`` rad to try for wall points ``(n, 2)``: those of the Hough spectra.

    Where walls have no directions (outdoors) a sweep, around the prior or of the whole circle.
    """
    settings, directions = config.rotation, config.directions
    spectrum_a, spectrum_b = (
        hough.spectrum_of(walls, settings.n_theta, config.resolution) for walls in (walls_a, walls_b)
    )
    angles, heights = hough.hypotheses(
        spectrum_a, spectrum_b, settings.n_peaks, directions.separation, settings.smoothing
    )
    first = np.arange(len(angles)) < 2 * settings.min_peaks  # each has a twin
    angles = angles[first | (heights >= settings.min_peak_ratio * heights[0])]
    straight = all(hough.has_directions(spectrum, directions) for spectrum in (spectrum_a, spectrum_b))
    if prior is None:
        if straight:
            return angles
        half = 0.5 * np.pi * np.arange(0.0, 1.0, 2.0 * settings.sweep_step / np.pi)
        return np.concatenate([half - np.pi, half - 0.5 * np.pi, half, half + 0.5 * np.pi])
    yaw = prior.T_a_b[2]
    reach = config.prior.sigmas * np.sqrt(prior.covariance[2, 2]) + config.prior.margin[1]
    angles = angles[np.abs(se2.wrap(angles - yaw)) <= reach]
    if len(angles) and straight:
        return angles
    count = int(np.ceil(min(reach, settings.sweep_limit) / settings.sweep_step))
    return np.concatenate([angles, se2.wrap(yaw + settings.sweep_step * np.arange(-count, count + 1))])


def search(a: Walls, b: Walls, angles: Array, prior: Prior | None, config: AlignConfig) -> list[Alternative]:
    """The best shifts of all rotations ``(m,)`` rad with the one penalty, then those with the other."""
    settings = config.search
    raster_a = a.raster(np.zeros(3), settings.resolution)
    turned = [
        (pair, b.raster(np.array([0.0, 0.0, pair[0]]), settings.resolution))
        for pair in paired_half_turns(angles)
    ]
    window = None if prior is None else _window(prior, config)
    shape = translation.padded_shape(raster_a, [raster for _, raster in turned], settings.blur, window)
    # one large piece of memory for all, which the system then leaves to us from one alignment to the next
    memory_a, memory_b = np.empty((2, 4, *translation.transform_shape(shape)), dtype=np.complex64)
    spectra_a = translation.spectra(raster_a, shape, memory_a)
    found: dict[float, list[Alternative]] = {settings.free_penalty: [], settings.lenient_penalty: []}
    for (*yaws,), raster_b in turned:
        upright = translation.spectra(raster_b, shape, memory_b)
        for k, yaw in enumerate(yaws):
            spectra_b = upright.half_turned() if k else upright
            correlation = translation.correlate(
                spectra_a, spectra_b, settings.blur, window, settings.facing_share
            )
            for penalty, alternatives in found.items():
                alternatives += _shifts(correlation, penalty, yaw, prior, config)
    centre = b.points.mean(axis=0)
    chosen = []
    for alternatives in found.values():
        alternatives.sort(key=lambda candidate: -candidate.score)
        chosen += _distinct(alternatives, centre, settings, settings.candidates)
    return chosen


def paired_half_turns(angles: Array) -> list[list[float]]:
    """Rotations ``(m,)`` rad, each together with its twin half a turn away where that is among them too."""
    pairs: list[list[float]] = []
    for angle in angles:
        twin = next((p for p in pairs if len(p) == 1 and abs(se2.wrap(angle - p[0] - np.pi)) < 1e-9), None)
        if twin is None:
            pairs.append([float(angle)])
        else:
            twin.append(float(angle))
    return pairs


def _shifts(
    correlation: translation.Correlation, penalty: float, yaw: float, prior: Prior | None, config: AlignConfig
) -> list[Alternative]:
    """The best shifts of one rotation."""
    score = correlation.score(penalty)
    if prior is not None and score.size:
        poses = np.concatenate([correlation.translations(), np.full((*score.shape, 1), yaw)], -1)
        score = score - prior_penalty(prior, poses, config.prior.weight)
    separation = int(config.search.separation[0] / correlation.resolution)
    return [
        Alternative(
            np.array([*(correlation.first + correlation.resolution * np.array([column, row])), yaw]),
            float(score[row, column]),
        )
        for row, column in translation.best_shifts(score, config.search.shifts_per_rotation, separation)
    ]


def _window(prior: Prior, config: AlignConfig) -> tuple[Array, Array]:
    """Corners of the box (axes of a) that holds the search around a prior."""
    R = se2.rotation(prior.T_a_b[2])
    deviation = np.sqrt(np.diag(R @ prior.covariance[:2, :2] @ R.T))
    reach = config.prior.sigmas * deviation + config.prior.margin[0]
    return prior.T_a_b[:2] - reach, prior.T_a_b[:2] + reach


def _distinct(
    candidates: list[Alternative], centre: Array, settings: SearchConfig, most: int | None = None
) -> list[Alternative]:
    """The first ``most`` candidates, without those near a better one, measured at b's ``centre (2,)``."""
    poses = np.array([candidate.T_a_b for candidate in candidates]).reshape(-1, 3)
    return [candidates[i] for i in distinct(poses, centre, settings.separation, most)]


def _located(a: Submap, b: Submap, field: ScoreField, best: Alternative) -> tuple[Array, Array] | NoStitch:
    """Pose ``(3,)`` and covariance ``(3, 3)`` of the best candidate, after the scan matcher if asked for."""
    pivot, settings = field.pivot(best.T_a_b), field.config.refinement
    sigma = covariance(field, best.T_a_b, pivot)
    if not settings.enabled:
        return best.T_a_b, sigma
    points = b.points.selected(np.arange(0, len(b.points), 1 + len(b.points) // settings.points))
    reference = Reference(a.points, LATTICE_CELL, LATTICE_SIDE)
    matched = match(reference, points, best.T_a_b, settings.method, config=settings.matcher)
    if isinstance(matched, NoMatch):  # too few of the points have a partner: the climb's answer stands
        return best.T_a_b, sigma
    T_a_b = matched.T_reference_scan
    moved = np.linalg.norm(se2.transform(T_a_b, pivot[None]) - se2.transform(best.T_a_b, pivot[None]))
    turned = abs(float(se2.wrap(T_a_b[2] - best.T_a_b[2])))
    if moved > settings.max_correction[0] or turned > settings.max_correction[1]:
        return NoStitch(f"the scan matcher left the peak by {moved:.2f} m and {turned:.3f} rad", best)
    return T_a_b, sigma + matched.covariance


def score_best(
    problem: AlignmentProblem, candidates: list[Alternative]
) -> tuple[acceptance.SharedArea, acceptance.CandidateScores]:
    """What the maps share at the first of the candidates, and all its scores."""
    (best, *others), field = candidates, problem.field
    b, T_a_b, config, prior = problem.b.walls, best.T_a_b, field.config, field.prior
    shared = acceptance.measure_shared_area(
        field.raster_a, rasterise(b.points, b.grid, T_a_b, config.resolution)
    )
    around = np.pi / 4.0 * np.arange(8)
    shifts = config.acceptance.slide * np.stack([np.cos(around), np.sin(around), np.zeros(8)], -1)
    left = field.agreement(T_a_b + shifts) - field.penalty / translation.LINE * field.conflict(T_a_b + shifts)
    agreement = float(field.agreement(T_a_b[None])[0])
    overlap, limits = count_overlap(problem.a, problem.b, T_a_b), config.acceptance
    turned = [c.T_a_b for c in others if abs(se2.wrap(c.T_a_b[2] - T_a_b[2])) > limits.equal_turn]
    rivals = [count_overlap(problem.a, problem.b, T) for T in turned]
    scores = acceptance.CandidateScores(
        log_odds=best.score,
        rivals=tuple(other.score for other in others),
        positional_distinctness=1.0 - float(left.max()) / max(agreement, 1e-9),
        overlap=overlap,
        prior_penalty=float(prior_penalty(prior, T_a_b, 1.0)),
        has_prior=prior is not None,
        equals=sum(acceptance.fits_as_well(rival, overlap, limits) for rival in rivals),
    )
    return shared, scores
