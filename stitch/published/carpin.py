"""Carpin's map merging: several Hough rotations, X and Y spectra, the best acceptance index wins.

S. Carpin, "Fast and accurate map merging for multi-robot systems", Autonomous Robots 25, 2008.
"""

from __future__ import annotations

import numpy as np

from slam.mapping.submap import Submap
from stitch.alignment.config import AlignConfig
from stitch.alignment.raster import Raster, common_windows
from stitch.alignment.result import Alternative, NoStitch, Prior, Stitch
from stitch.alignment.rotation import hypotheses, reason_against_directions
from stitch.alignment.translation import by_spectra
from stitch.published.htms import dominant_direction
from stitch.published.pair import near, pair, redraw


def align_carpin(a: Submap, b: Submap, prior: Prior | None, config: AlignConfig) -> Stitch | NoStitch:
    """The hypothesis with the best acceptance index ω, which is its score.

    A prior excludes hypotheses, no more. The threshold on ω and the refusal of maps without two directions
    are ours.
    """
    settings, maps = config.carpin, pair(a, b, config)
    if isinstance(maps, NoStitch):
        return maps
    spectrum_a, spectrum_b = maps.spectra(settings.n_theta, split=False)
    reason = reason_against_directions(spectrum_a, spectrum_b, config.directions)
    if reason is not None:
        return NoStitch(reason)
    angles, _ = hypotheses(spectrum_a, spectrum_b, settings.n_peaks, config.directions.separation, 0.0)
    direction = dominant_direction(spectrum_a)
    cells_a = redraw(a.grid, np.zeros(3), config.resolution)
    candidates = []
    for angle in angles:
        t, _ = by_spectra(maps.walls_a, maps.walls_b, angle, direction, config.resolution)
        T_a_b = np.array([*t, angle])
        omega = acceptance_index(cells_a, redraw(b.grid, T_a_b, config.resolution))
        candidates.append(Alternative(T_a_b, omega))
    best, *others = sorted(candidates, key=lambda candidate: -candidate.score)
    allowed = near([best, *others], prior, config)
    if not allowed:
        return NoStitch(f"none of {len(candidates)} hypotheses is near the prior", best)
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
