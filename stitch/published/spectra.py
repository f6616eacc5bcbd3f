"""The aligners of the literature that read Hough spectra: the thesis's stitching, Carpin's, Censi's.

htms (Formsma, ch. 3): Hough transform with whole votes and bins of one degree; spectrum (eq. 3.2); circular
cross-correlation (eq. 3.3; k is counted as the rotation of b here); its two highest peaks, each with θ + π
(section 3.4); dominant direction φ of map a; X and Y spectra after turning a by -φ and b by θ - φ (section
3.5); of the four hypotheses the one nearest the inertial sensor's rotation (sections 3.6 and 4.3). Chosen
here: the size of a ρ bin (one cell) and of a cell, and how near each other two peaks may be (10°). Points are
turned, not images, and lags are not two pixels short as in the thesis's program.

carpin: S. Carpin, "Fast and accurate map merging for multi-robot systems", Autonomous Robots 25, 2008.
censi: A. Censi, L. Iocchi, G. Grisetti, "Scan matching in the Hough domain", ICRA 2005.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import product

import numpy as np

from slam import se2
from slam.mapping.occupancy import Grid
from slam.mapping.submap import Submap
from slam.se2 import Array
from stitch.alignment import hough
from stitch.alignment.acceptance import measure_shared_area
from stitch.alignment.config import AlignConfig
from stitch.alignment.hough import common_directions, hypotheses, reason_against_directions
from stitch.alignment.raster import Raster, common_windows, lattice_window, look_up, rasterise
from stitch.alignment.result import Alternative, NoStitch, Prior, Stitch
from stitch.alignment.translation import by_spectra, lags

PEAKS = 2
"""The thesis's θ₁ and θ₂; with their twins four hypotheses (its figure 3.11)."""
DIRECTIONS = 180
"""Bins of θ: whole degrees."""


@dataclass(frozen=True)
class Pair:
    """Two submaps and how they are aligned."""

    a: Submap
    b: Submap
    config: AlignConfig

    @cached_property
    def walls_a(self) -> Array:
        """Centres ``(n, 2)`` m of the occupied cells of a."""
        return self.a.grid.occupied_points()

    @cached_property
    def walls_b(self) -> Array:
        """Centres ``(m, 2)`` m of the occupied cells of b."""
        return self.b.grid.occupied_points()

    def spectra(self, n_theta: int, split: bool) -> tuple[Array, Array]:
        """Hough spectra ``(n_theta,)`` of both maps, with bins of ρ of the raster's resolution."""
        transforms = (
            hough.transform(walls, n_theta, self.config.resolution, split)
            for walls in (self.walls_a, self.walls_b)
        )
        of_a, of_b = map(hough.spectrum, transforms)
        return of_a, of_b

    def stitch(self, best: Alternative, others: list[Alternative]) -> Stitch:
        """The best candidate as an answer, with the area shared there; it has no covariance."""
        resolution = self.config.resolution
        still = rasterise(self.walls_a, self.a.grid, np.zeros(3), resolution)
        moved = rasterise(self.walls_b, self.b.grid, best.T_a_b, resolution)
        shared = measure_shared_area(still, moved)
        ranked = tuple(sorted(others, key=lambda other: -other.score))
        return Stitch(best.T_a_b, None, best.score, shared.overlap_area, shared.agreement, ranked)


def near(candidates: list[Alternative], prior: Prior | None, config: AlignConfig) -> list[Alternative]:
    """Candidates that the prior does not exclude; all of them without a prior."""
    if prior is None:
        return candidates
    limit = se2.max_distance(config.prior.confidence)
    return [candidate for candidate in candidates if prior.distance(candidate.T_a_b) <= limit]


def redraw(grid: Grid, T: Array, resolution: float) -> Raster:
    """A grid moved by ``T (3,)`` onto the lattice of ``resolution`` m, with nothing left out.

    A cell is occupied when the grid is at its centre (walls keep closed when cells get finer) or when the
    centre of an occupied cell falls into it (walls are not lost when they get coarser).
    """
    first, shape = lattice_window(grid, T, resolution)
    occupied, free = (
        look_up(cells, grid.origin, grid.resolution, T, first, shape, resolution)
        for cells in (grid.occupied, grid.free)
    )
    column, row = (np.floor(se2.transform(T, grid.occupied_points()) / resolution) - first).astype(int).T
    # a centre on the border may round to either side of it
    occupied[np.clip(row, 0, shape[0] - 1), np.clip(column, 0, shape[1] - 1)] = True
    return Raster(occupied, free & ~occupied, first, resolution)


def align_htms(a: Submap, b: Submap, prior: Prior | None, config: AlignConfig) -> Stitch:
    """The rotation nearest the prior's (nearest zero without one) and its X/Y translation, unverified.

    Of the prior only the rotation is read. Always answers, and has no covariance.
    """
    maps = Pair(a, b, config)
    candidates = four_hypotheses(maps)
    expected = 0.0 if prior is None else prior.T_a_b[2]
    turns = [abs(float(se2.wrap(candidate.T_a_b[2] - expected))) for candidate in candidates]
    chosen = candidates.pop(int(np.argmin(turns)))
    return maps.stitch(chosen, candidates)


def four_hypotheses(maps: Pair) -> list[Alternative]:
    """θ₁, θ₁ + π, θ₂ and θ₂ + π with their translations; two only where the correlation has one peak."""
    return hypotheses_by_spectra(maps, maps.spectra(DIRECTIONS, split=False), PEAKS)


def hypotheses_by_spectra(maps: Pair, spectra: tuple[Array, Array], n_peaks: int) -> list[Alternative]:
    """The rotations of ``n_peaks`` peaks and their twins, with the translations by X and Y spectra."""
    angles, _ = hypotheses(*spectra, n_peaks, maps.config.directions.separation, 0.0)
    direction = dominant_direction(spectra[0])
    candidates = []
    for angle in angles:
        t, score = by_spectra(maps.walls_a, maps.walls_b, angle, direction, maps.config.resolution)
        candidates.append(Alternative(np.array([*t, angle]), score))
    return candidates


def dominant_direction(spectrum: Array) -> float:
    """φ rad in ``[0, π)``: where a spectrum ``(n_theta,)`` is highest."""
    return float(np.argmax(spectrum)) * np.pi / len(spectrum)


def align_carpin(a: Submap, b: Submap, prior: Prior | None, config: AlignConfig) -> Stitch | NoStitch:
    """The hypothesis with the best acceptance index ω, which is its score.

    A prior excludes hypotheses, no more. The threshold on ω and the refusal of maps without two directions
    are ours.
    """
    settings, maps = config.carpin, Pair(a, b, config)
    spectra = maps.spectra(settings.n_theta, split=False)
    reason = reason_against_directions(*spectra, config.directions)
    if reason is not None:
        return NoStitch(reason)
    cells_a = redraw(a.grid, np.zeros(3), config.resolution)
    candidates = [
        Alternative(c.T_a_b, acceptance_index(cells_a, redraw(b.grid, c.T_a_b, config.resolution)))
        for c in hypotheses_by_spectra(maps, spectra, settings.n_peaks)
    ]
    candidates.sort(key=lambda candidate: -candidate.score)
    allowed = near(candidates, prior, config)
    if not allowed:
        return NoStitch(f"none of {len(candidates)} hypotheses is near the prior", candidates[0])
    omega, least = allowed[0].score, settings.min_acceptance_index
    if omega < least:
        return NoStitch(f"acceptance index {omega:.3g}, expected at least {least}", allowed[0])
    return maps.stitch(allowed[0], allowed[1:])


def acceptance_index(a: Raster, b: Raster) -> float:
    """``ω = agree / (agree + disagree)`` of two maps on one lattice, 0 where they do not overlap.

    Cells agree when both are occupied or both free, disagree when one is occupied and the other free; what
    either does not know does not count.
    """
    windows = common_windows(a, b)
    if windows is None:
        return 0.0
    occupied_a, free_a = a.occupied[windows[0]], a.free[windows[0]]
    occupied_b, free_b = b.occupied[windows[1]], b.free[windows[1]]
    agree = np.sum(occupied_a & occupied_b) + np.sum(free_a & free_b)
    disagree = np.sum(occupied_a & free_b) + np.sum(free_a & occupied_b)
    return float(agree / max(agree + disagree, 1))


def align_censi(a: Submap, b: Submap, prior: Prior | None, config: AlignConfig) -> Stitch | NoStitch:
    """The rotation and translation with the most weight of correlation behind it; without a covariance.

    A prior excludes solutions, no more. There is no test of the answer; the refusal of maps without two
    directions is ours.
    """
    settings, maps = config.censi, Pair(a, b, config)
    spectra = maps.spectra(settings.n_theta, split=True)
    reason = reason_against_directions(*spectra, config.directions)
    if reason is not None:
        return NoStitch(reason)
    angles, _ = hypotheses(*spectra, settings.n_peaks, config.directions.separation, settings.smoothing)
    found: list[Alternative] = []
    for angle in angles:
        directions = common_directions(*spectra, angle, settings.directions, config.directions)
        if len(directions) >= 2:
            found += solutions(maps, angle, directions)
    if not found:
        return NoStitch("no translation agrees with the lags of all directions")
    found.sort(key=lambda solution: -solution.score)
    allowed = near(found, prior, config)
    if not allowed:
        return NoStitch(f"none of {len(found)} solutions is near the prior", found[0])
    best, *others = allowed
    return maps.stitch(best, others[: 2 * settings.n_peaks])


def solutions(maps: Pair, yaw: float, directions: Array) -> list[Alternative]:
    """Translations for b turned by ``yaw``: every combination of lags that one translation explains.

    Along the unit vector u of a direction, ``ρ_a = ρ_b + t·u``; t is the least squares solution over the
    directions ``(m,)`` rad, weighted by the correlation at the lags, whose sum is the score.
    """
    u = np.stack([np.cos(directions), np.sin(directions)], -1)
    turned_b = maps.walls_b @ se2.rotation(yaw).T
    resolution, settings = maps.config.resolution, maps.config.censi
    peaks = [lags(maps.walls_a @ axis, turned_b @ axis, resolution, settings.lags) for axis in u]
    chosen = np.array(list(product(*(range(len(scores)) for _, scores in peaks))))
    delta, weight = (np.stack([peaks[m][part][chosen[:, m]] for m in range(len(u))], -1) for part in (0, 1))
    information = np.einsum("cm,mi,mj->cij", weight, u, u)
    t = np.linalg.solve(information, np.einsum("cm,cm,mi->ci", weight, delta, u)[..., None])[..., 0]
    agree = np.abs(t @ u.T - delta).max(axis=1) <= settings.max_residual * resolution
    return [Alternative(np.array([*t[c], yaw]), float(weight[c].sum())) for c in np.flatnonzero(agree)]
