"""The thesis's stitching (Formsma, ch. 3): Hough spectra for rotation, X and Y spectra for translation.

Hough transform with whole votes and bins of one degree; spectrum (eq. 3.2); circular cross-correlation (eq.
3.3; k is counted as the rotation of b here); its two highest peaks, each with θ + π (section 3.4); dominant
direction φ of map a; X and Y spectra after turning a by -φ and b by θ - φ (section 3.5); of the four
hypotheses the one nearest the inertial sensor's rotation (sections 3.6 and 4.3). Chosen here: the size of a ρ
bin (one cell) and of a cell, and how near each other two peaks may be (10°). Points are turned, not images,
and lags are not two pixels short as in the thesis's program.
"""

from __future__ import annotations

import numpy as np

from slam import se2
from slam.mapping.submap import Submap
from slam.se2 import Array
from stitch.alignment.config import AlignConfig
from stitch.alignment.hough import hypotheses
from stitch.alignment.result import Alternative, Prior, Stitch
from stitch.alignment.translation import by_spectra
from stitch.published.pair import Pair

PEAKS = 2
"""The thesis's θ₁ and θ₂; with their twins four hypotheses (its figure 3.11)."""
DIRECTIONS = 180
"""Bins of θ: whole degrees."""


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
