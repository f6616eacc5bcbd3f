"""The thesis's stitching: Hough spectra for rotation, X and Y spectra for translation (Formsma, ch. 3).

Step by step: Hough transform with whole votes and bins of one degree (the thesis gives its angles in whole
degrees, as does its published program); spectrum (eq. 3.2); circular cross-correlation (eq. 3.3; k is counted
as the rotation of b here); its two highest peaks, each with θ + π (section 3.4); dominant direction φ of map
a; X and Y spectra after turning a by -φ and b by θ - φ (section 3.5); of the four hypotheses the one nearest
the inertial sensor's rotation (sections 3.6 and 4.3).

What the thesis does not say, and is chosen here: the size of a ρ bin (one cell); how near each other two
peaks may be (10°); the size of a cell. Its program turns images, which thickens walls, and takes each lag two
pixels short; points are turned here, and lags are right.
"""

from __future__ import annotations

import numpy as np

from slam import se2
from slam.mapping.submap import Submap
from slam.se2 import Array
from stitch.alignment.config import AlignConfig
from stitch.alignment.result import Alternative, NoStitch, Prior, Stitch
from stitch.alignment.rotation import hypotheses
from stitch.alignment.translation import by_spectra
from stitch.published.pair import Pair, pair

PEAKS = 2
"""The thesis's θ₁ and θ₂; with their twins four hypotheses (its figure 3.11)."""
DIRECTIONS = 180
"""Bins of θ: whole degrees."""


def align_htms(a: Submap, b: Submap, prior: Prior | None, config: AlignConfig) -> Stitch | NoStitch:
    """The rotation nearest the prior's (nearest zero without one) and its X/Y translation, unverified.

    Of the prior only the rotation is read. Always answers when both maps have walls, and has no covariance.
    """
    maps = pair(a, b, config)
    if isinstance(maps, NoStitch):
        return maps
    candidates = four_hypotheses(maps)
    expected = 0.0 if prior is None else prior.T_a_b[2]
    turns = [abs(float(se2.wrap(candidate.T_a_b[2] - expected))) for candidate in candidates]
    chosen = candidates.pop(int(np.argmin(turns)))
    return maps.stitch(chosen, candidates)


def four_hypotheses(maps: Pair) -> list[Alternative]:
    """θ₁, θ₁ + π, θ₂ and θ₂ + π with their translations; two only where the correlation has one peak."""
    spectrum_a, spectrum_b = maps.spectra(DIRECTIONS, split=False)
    angles, _ = hypotheses(spectrum_a, spectrum_b, PEAKS, maps.config.directions.separation, 0.0)
    direction = dominant_direction(spectrum_a)
    candidates = []
    for angle in angles:
        t, score = by_spectra(maps.walls_a, maps.walls_b, angle, direction, maps.config.resolution)
        candidates.append(Alternative(np.array([*t, angle]), score))
    return candidates


def dominant_direction(spectrum: Array) -> float:
    """φ rad in ``[0, π)``: where a spectrum ``(n_theta,)`` is highest."""
    return float(np.argmax(spectrum)) * np.pi / len(spectrum)
