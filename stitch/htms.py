"""The report's stitching: Hough spectra for rotation, X and Y spectra for translation (Formsma, ch. 3)."""

from __future__ import annotations

import numpy as np

from slam import se2
from slam.submap import Submap
from stitch import hough
from stitch.config import AlignConfig
from stitch.raster import rasterise
from stitch.result import Alternative, NoStitch, Prior, Stitch
from stitch.rotation import hypotheses
from stitch.translation import by_spectra
from stitch.verification import measure

PEAKS = 2
"""The report's θ₁ and θ₂; with their twins four hypotheses (its figure 3.11)."""


def align_htms(a: Submap, b: Submap, prior: Prior | None, config: AlignConfig) -> Stitch | NoStitch:
    """The rotation nearest the prior's (nearest zero without one) and its X/Y translation, unverified.

    Of the prior only the rotation is read. Always answers when both maps have walls, and has no covariance.
    """
    walls_a, walls_b = a.grid.occupied_points(), b.grid.occupied_points()
    for name, walls in (("a", walls_a), ("b", walls_b)):
        if len(walls) == 0:
            return NoStitch(f"submap {name} has no occupied cells")
    spectrum_a, spectrum_b = (
        hough.spectrum(hough.transform(walls, config.n_theta, config.resolution))
        for walls in (walls_a, walls_b)
    )
    angles, _ = hypotheses(spectrum_a, spectrum_b, PEAKS, smoothing=0.0)
    direction = float(np.argmax(spectrum_a)) * np.pi / config.n_theta
    candidates = []
    for angle in angles:
        t, score = by_spectra(walls_a, walls_b, angle, direction, config.resolution)
        candidates.append(Alternative(np.array([*t, angle]), score))
    expected = 0.0 if prior is None else prior.T_a_b[2]
    turns = [abs(float(se2.wrap(candidate.T_a_b[2] - expected))) for candidate in candidates]
    chosen = candidates.pop(int(np.argmin(turns)))
    still = rasterise(walls_a, a.grid, np.zeros(3), config.resolution)
    evidence = measure(still, rasterise(walls_b, b.grid, chosen.T_a_b, config.resolution))
    return Stitch(
        T_a_b=chosen.T_a_b,
        covariance=None,
        score=chosen.score,
        overlap_area=evidence.overlap_area,
        agreement=evidence.agreement,
        alternatives=tuple(sorted(candidates, key=lambda candidate: -candidate.score)),
    )
