"""Censi's scan matching in the Hough domain, on maps.

A. Censi, L. Iocchi, G. Grisetti, "Scan matching in the Hough domain", ICRA 2005.
"""

from __future__ import annotations

from itertools import product

import numpy as np

from slam import se2
from slam.mapping.submap import Submap
from slam.se2 import Array
from stitch.alignment.config import AlignConfig
from stitch.alignment.hough import common_directions, hypotheses, reason_against_directions
from stitch.alignment.result import Alternative, NoStitch, Prior, Stitch
from stitch.alignment.translation import lags
from stitch.published.pair import Pair, near


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
    answers: list[Alternative] = []
    for angle in angles:
        directions = common_directions(*spectra, angle, settings.directions, config.directions)
        if len(directions) >= 2:
            answers += solutions(maps, angle, directions)
    if not answers:
        return NoStitch("no translation agrees with the lags of all directions")
    answers.sort(key=lambda solution: -solution.score)
    allowed = near(answers, prior, config)
    if not allowed:
        return NoStitch(f"none of {len(answers)} solutions is near the prior", answers[0])
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
