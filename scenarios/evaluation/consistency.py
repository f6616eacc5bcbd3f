"""Does a method's covariance tell the truth about its error?"""

from __future__ import annotations

import numpy as np
from scipy.stats import chi2

from scenarios.evaluation.metric import Metric, measured, missing
from slam import se2
from slam.se2 import Array

NAMES = ("anees",)


def squared_errors(poses: Array, covariance: Array, truth: Array) -> Array:
    """Normalised estimation errors squared ``(K,)``, expected 3 each.

    Poses ``(N, 3)`` and ``truth (N, 3)`` are taken relative to their first, because a map has no frame of its
    own; the error of each is in its body tangent, as ``covariance (N, 3, 3)`` is. The first pose, and those
    whose covariance is not finite or not positive definite, are left out.
    """
    error = se2.log(se2.between(se2.between(poses[0], poses), se2.between(truth[0], truth)))[1:]
    sigma = covariance[1:]
    usable = np.all(np.isfinite(sigma), axis=(1, 2))
    usable[usable] = np.linalg.eigvalsh(sigma[usable])[:, 0] > 0.0
    error, sigma = error[usable], sigma[usable]
    return np.einsum("ni,ni->n", error, np.linalg.solve(sigma, error[..., None])[..., 0])


def last_squared_error(poses: Array, covariance: Array | None, truth: Array) -> float:
    """Normalised estimation error squared of the last pose, expected 3; NaN where no covariance is usable.

    One number per drive: over many drives these are independent, which the poses of one drive are not.
    """
    if covariance is None:
        return float("nan")
    ends = [0, -1]
    nees = squared_errors(poses[ends], covariance[ends], truth[ends])
    return float(nees[0]) if len(nees) else float("nan")


def band(runs: int, probability: float = 0.95) -> tuple[float, float]:
    """Interval that holds the average of ``runs`` independent squared errors, / 3, of an honest covariance.

    χ² with ``3 runs`` degrees of freedom (Bar-Shalom, Li & Kirubarajan 2001, §5.4). Raises ``ValueError`` for
    no runs.
    """
    if runs < 1:
        raise ValueError(f"band: expected one run or more, got {runs}")
    tail, freedom = (1.0 - probability) / 2.0, 3 * runs
    return float(chi2.ppf(tail, freedom)) / freedom, float(chi2.ppf(1.0 - tail, freedom)) / freedom


def consistency_metrics(
    method: str, poses: Array, covariance: Array | None, truth: Array | None
) -> list[Metric]:
    """Average normalised estimation error squared over 3: above 1 is over-confident, below 1 timid."""
    if covariance is None:
        return missing(method, NAMES, "the method states no covariance of its poses")
    if truth is None:
        return missing(method, NAMES, "the recording has no truth")
    nees = squared_errors(poses, covariance, truth)
    if len(nees) == 0:
        return missing(method, NAMES, "no pose has a usable covariance")
    return measured(method, {"anees": nees.mean() / 3.0})
