"""Does a method's covariance tell the truth about its error?"""

from __future__ import annotations

import numpy as np

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
