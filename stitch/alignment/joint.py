"""Our stitching: Hough rotations, a search of all shifts, climbing, a judgement by what the walls meet."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any, TypeVar

import numpy as np

from slam import se2
from slam.mapping.submap import Submap
from slam.matching import MatchConfig, Reference
from slam.se2 import Array
from stitch.alignment import hough
from stitch.alignment.acceptance import belief
from stitch.alignment.config import AlignConfig
from stitch.alignment.likelihood import GUIDED, Ground, likeness, tally
from stitch.alignment.raster import Walls, rasterise, walls_of
from stitch.alignment.refinement import ScoreField, climb, covariance, prior_penalty, score_field
from stitch.alignment.result import Alternative, NoStitch, Prior, Stitch
from stitch.alignment.rotation import hypotheses
from stitch.alignment.translation import (
    LINE,
    Correlation,
    best_shifts,
    correlate,
    padded_shape,
    spectra,
    transform_shape,
)
from stitch.alignment.verification import Evidence, Standing, far_from, measure, reason_against

Pose = TypeVar("Pose", "Alternative", "Candidate")

DISTINCT = (0.5, np.radians(5.0))
"""Alignments nearer than this (m at b's walls, rad) are one peak."""
SHIFTS_PER_ROTATION = 3
STRIDE = 3
"""One wall point in so many is read while many alternatives climb."""
FINALISTS = 6
"""Candidates that climb on with all points."""
NEARLY = 0.9
"""Share of the highest peak of the spectra's correlation that a third needs; right angles have two."""
SLIDE = 0.4
"""An alignment is moved this far [m] in eight directions to see how much of its agreement is lost."""
REFINE_POINTS = 1000
"""About how many of b's points the scan matcher is given: more cost time and tell it nothing new."""
SURFACE_CELL, SURFACE_SIDE = 0.1, 512
"""Cells [m] of the lattice of a submap's points, and how many along a side."""
REFINEMENT = MatchConfig(levels=((0.3, 1), (0.2, 1)), least_pairs=30, search_shift=0.0)
PRIOR_MARGIN = (0.5, np.radians(2.0))
"""Added to the search around a prior (m, rad): its covariance says nothing about the grid's cells."""


class Surfaces(Reference):
    """A submap's points, which are many more, and lie over more ground, than those of one scan.

    The lattice that finds them repeats itself every 51 m, not 13.
    """

    @cached_property
    def indexed(self) -> tuple[Any, Any]:
        """The points and their lattice."""
        from slam.matching.neighbours import build

        return self.cloud, build(self.cloud[0], SURFACE_CELL, SURFACE_SIDE)


@dataclass(frozen=True)
class Candidate:
    """An alignment and its log-odds, see `Scene.odds`."""

    T_a_b: Array
    odds: float

    @property
    def alternative(self) -> Alternative:
        """What is told of it."""
        return Alternative(self.T_a_b, self.odds)


@dataclass(frozen=True)
class Scene:
    """Two maps, and what is known before, made ready to judge alignments."""

    a: Ground
    b: Ground
    field: ScoreField

    @property
    def prior(self) -> Prior | None:
        """What is known before."""
        return self.field.prior

    @classmethod
    def of(cls, a: Walls, b: Walls, prior: Prior | None, config: AlignConfig) -> Scene:
        """The scene of two maps' walls; a climb weighs conflicts between the two searches' penalties."""
        penalty = float(np.sqrt(config.free_penalty * config.lenient_penalty))
        return cls(Ground.of(a), Ground.of(b), score_field(a, b, penalty, prior, config))

    def odds(self, T_a_b: Array) -> float:
        """Log-odds of an alignment: of its likeness, and of the prior where there is one."""
        odds = likeness(tally(self.a, self.b, T_a_b))
        return odds if self.prior is None else odds + GUIDED - float(prior_penalty(self.prior, T_a_b, 1.0))


def align_joint(a: Submap, b: Submap, prior: Prior | None, config: AlignConfig) -> Stitch | NoStitch:
    """The alignment that is most likely the same place, if it can be believed (see `stitch.align.align`)."""
    walls_a, walls_b = walls_of(a, config.resolution), walls_of(b, config.resolution)
    for name, walls in (("a", walls_a), ("b", walls_b)):
        if len(walls.points) == 0:
            return NoStitch(f"submap {name} has no occupied cells")
    scene = Scene.of(walls_a, walls_b, prior, config)
    candidates = tops(scene, config)
    if not candidates:
        return NoStitch("the prior leaves no alignment at which the maps touch")
    best = candidates[0]
    evidence, standing = shown(scene, candidates, config)
    believed = belief(evidence, standing)
    reason = reason_against(evidence, standing, believed, config.acceptance)
    if reason is not None:
        return NoStitch(reason, best.alternative)
    located = _located(a, b, scene.field, best, config)
    if isinstance(located, NoStitch):
        return located
    T_a_b, sigma = located[0], (located[1] + located[1].T) / 2.0
    reason = far_from(prior, T_a_b, sigma, config.acceptance)
    if reason is not None:
        return NoStitch(reason, Alternative(T_a_b, best.odds))
    others = tuple(other.alternative for other in candidates if other is not best)
    return Stitch(T_a_b, sigma, best.odds, evidence.overlap_area, evidence.agreement, others, believed)


def tops(scene: Scene, config: AlignConfig) -> list[Candidate]:
    """The distinct alignments that a search of all rotations and shifts leads to, the likeliest first."""
    a, b = scene.a.walls, scene.b.walls
    angles = rotations(a.points, b.points, scene.prior, config)
    return _climbed(search(a, b, angles, scene.prior, config), scene, b.points.mean(axis=0))


def rotations(walls_a: Array, walls_b: Array, prior: Prior | None, config: AlignConfig) -> Array:
    """Rotations ``(m,)`` rad worth trying: Hough's; where walls have no directions (outdoors) a sweep, around
    the prior or of the whole circle."""
    spectrum_a, spectrum_b = (
        hough.spectrum_of(walls, config.n_theta, config.resolution) for walls in (walls_a, walls_b)
    )
    angles, heights = hypotheses(spectrum_a, spectrum_b, config.n_peaks)
    angles = angles[(np.arange(len(angles)) < 4) | (heights >= NEARLY * heights[0])]
    straight = hough.gridness(spectrum_a).trustworthy and hough.gridness(spectrum_b).trustworthy
    if prior is None:
        half = 0.5 * np.pi * np.arange(0.0, 1.0, 2.0 * config.sweep_step / np.pi)
        return (
            angles
            if straight
            else np.concatenate([half - np.pi, half - 0.5 * np.pi, half, half + 0.5 * np.pi])
        )
    yaw = prior.T_a_b[2]
    reach = config.prior_sigmas * np.sqrt(prior.covariance[2, 2]) + PRIOR_MARGIN[1]
    angles = angles[np.abs(se2.wrap(angles - yaw)) <= reach]
    if len(angles) and straight:
        return angles
    count = int(np.ceil(min(reach, config.sweep_limit) / config.sweep_step))
    return np.concatenate([angles, se2.wrap(yaw + config.sweep_step * np.arange(-count, count + 1))])


def search(a: Walls, b: Walls, angles: Array, prior: Prior | None, config: AlignConfig) -> list[Alternative]:
    """The best shifts of all rotations.

    Half of them are the best where little may contradict, half where something was moved or a map is bent.
    """
    raster_a = a.raster(np.zeros(3), config.search_resolution)
    turned = [
        (pair, b.raster(np.array([0.0, 0.0, pair[0]]), config.search_resolution)) for pair in paired(angles)
    ]
    window = None if prior is None else _window(prior, config)
    shape = padded_shape(raster_a, [raster for _, raster in turned], config.blur, window)
    # one large piece of memory for all, which the system then leaves to us from one alignment to the next
    room_a, room_b = np.empty((2, 4, *transform_shape(shape)), dtype=np.complex64)
    spectra_a = spectra(raster_a, shape, room_a)
    found: dict[float, list[Alternative]] = {config.free_penalty: [], config.lenient_penalty: []}
    for (*yaws,), raster_b in turned:
        upright = spectra(raster_b, shape, room_b)
        for k, yaw in enumerate(yaws):
            spectra_b = upright.half_turned() if k else upright
            correlation = correlate(spectra_a, spectra_b, config.blur, window)
            for penalty, alternatives in found.items():
                alternatives += _shifts(correlation, penalty, yaw, prior, config.prior_weight)
    centre = b.points.mean(axis=0)
    chosen = []
    for alternatives in found.values():
        alternatives.sort(key=lambda candidate: -candidate.score)
        chosen += _distinct(alternatives, centre, config.candidates)
    return chosen


def paired(angles: Array) -> list[list[float]]:
    """Rotations rad, each together with its twin half a turn on where that is among them too."""
    pairs: list[list[float]] = []
    for angle in angles:
        twin = next((p for p in pairs if len(p) == 1 and abs(se2.wrap(angle - p[0] - np.pi)) < 1e-9), None)
        if twin is None:
            pairs.append([float(angle)])
        else:
            twin.append(float(angle))
    return pairs


def _shifts(
    correlation: Correlation, penalty: float, yaw: float, prior: Prior | None, weight: float
) -> list[Alternative]:
    """The best shifts of one rotation."""
    score = correlation.score(penalty)
    if prior is not None and score.size:
        poses = np.concatenate([correlation.translations(), np.full((*score.shape, 1), yaw)], -1)
        score = score - prior_penalty(prior, poses, weight)
    separation = int(DISTINCT[0] / correlation.resolution)
    return [
        Alternative(
            np.array([*(correlation.first + correlation.resolution * np.array([column, row])), yaw]),
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


def _climbed(found: list[Alternative], scene: Scene, centre: Array) -> list[Candidate]:
    """The distinct tops that the alternatives climb to, the likeliest first.

    All of them climb coarsely, with a part of the points; those that may become the best or its rival then go
    on to 12.5 mm and 0.125°.
    """
    field, step = scene.field, (0.025, np.radians(0.25))
    starts = {tuple(c.T_a_b): c.T_a_b for c in found}.values()  # many are found with either penalty
    coarse = [climb(field, T_a_b, _pivot(field, T_a_b), halvings=1, stride=STRIDE)[0] for T_a_b in starts]
    ranked = _distinct(_ranked(coarse, scene), centre)[:FINALISTS]
    fine = [climb(field, c.T_a_b, _pivot(field, c.T_a_b), step, halvings=1)[0] for c in ranked]
    return _distinct(_ranked(fine, scene), centre)


def _ranked(poses: list[Array], scene: Scene) -> list[Candidate]:
    """Candidates, the likeliest first."""
    candidates = [Candidate(T_a_b, scene.odds(T_a_b)) for T_a_b in poses]
    return sorted(candidates, key=lambda candidate: -candidate.odds)


def _distinct(candidates: list[Pose], centre: Array, most: int | None = None) -> list[Pose]:
    """The first ``most`` candidates, best first, without those that share a better one's peak; measured at
    b's ``centre``."""
    poses = np.array([candidate.T_a_b for candidate in candidates]).reshape(-1, 3)
    centres = se2.transform(poses, centre[None])[:, 0].tolist()
    yaws = poses[:, 2].tolist()
    kept: list[int] = []
    for i in range(len(candidates)):
        if len(kept) == most:
            break
        if all(
            math.dist(centres[k], centres[i]) > DISTINCT[0] or _apart(yaws[k], yaws[i]) > DISTINCT[1]
            for k in kept
        ):
            kept.append(i)
    return [candidates[i] for i in kept]


def _apart(yaw: float, other: float) -> float:
    """Angle [rad] between two directions; of plain numbers, which numpy is slow with."""
    return abs((yaw - other + math.pi) % (2.0 * math.pi) - math.pi)


def _pivot(field: ScoreField, T_a_b: Array) -> Array:
    """Where b is held while it turns: the middle of its walls that a knows something about."""
    from stitch.alignment.kernels import middle_of_known

    points = field.points_b[::STRIDE]
    return middle_of_known(points, field.field_a, field.first_a, field.config.resolution, T_a_b)


def _located(
    a: Submap, b: Submap, field: ScoreField, best: Candidate, config: AlignConfig
) -> tuple[Array, Array] | NoStitch:
    """Pose ``(3,)`` and covariance ``(3, 3)`` of the best candidate, after the scan matcher if asked for."""
    pivot = _pivot(field, best.T_a_b)
    sigma = covariance(field, best.T_a_b, pivot)
    if not config.refine:
        return best.T_a_b, sigma
    from slam.matching import NoMatch, match

    reference = Surfaces(a.points)
    some = b.points.selected(np.arange(0, len(b.points), 1 + len(b.points) // REFINE_POINTS))
    answer = match(reference, some, best.T_a_b, "plicp", config=REFINEMENT)
    if isinstance(answer, NoMatch):  # too few of the points have a partner: the climb's answer stands
        return best.T_a_b, sigma
    T_a_b = answer.T_reference_scan
    moved = np.linalg.norm(se2.transform(T_a_b, pivot[None]) - se2.transform(best.T_a_b, pivot[None]))
    turned = abs(float(se2.wrap(T_a_b[2] - best.T_a_b[2])))
    if moved > config.refine_limit[0] or turned > config.refine_limit[1]:
        return NoStitch(
            f"the scan matcher left the peak by {moved:.2f} m and {turned:.3f} rad", best.alternative
        )
    return T_a_b, sigma + answer.covariance


def shown(scene: Scene, candidates: list[Candidate], config: AlignConfig) -> tuple[Evidence, Standing]:
    """What speaks for the first of the candidates and against it: what the maps share there, and how it
    stands by itself, against sliding along its walls and against the others."""
    (best, *others), field = candidates, scene.field
    T_a_b = best.T_a_b
    b = scene.b.walls
    evidence = measure(field.raster_a, rasterise(b.points, b.grid, T_a_b, config.resolution))
    around = np.pi / 4.0 * np.arange(8)
    shifts = SLIDE * np.stack([np.cos(around), np.sin(around), np.zeros(8)], -1)
    left = field.agreement(T_a_b + shifts) - field.penalty / LINE * field.conflict(T_a_b + shifts)
    agreement = float(field.agreement(T_a_b[None])[0])
    standing = Standing(
        odds=best.odds,
        rivals=tuple(other.odds for other in others),
        firmness=1.0 - float(left.max()) / max(agreement, 1e-9),
        tally=tally(scene.a, scene.b, T_a_b),
        unlikely=0.0 if scene.prior is None else float(prior_penalty(scene.prior, T_a_b, 1.0)),
        guided=scene.prior is not None,
    )
    return evidence, standing
