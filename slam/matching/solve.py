"""A whole match in one compiled call: the answer, how well it fits, and how sure it is."""

from __future__ import annotations

import numpy as np
from numba import njit

from slam.matching.alternating import alternate
from slam.matching.covariance import body_covariance
from slam.matching.estimate import estimate
from slam.matching.residuals import residual_quantile
from slam.matching.search import misfit

FAR = 0.9
"""Share of the pairs whose distance is told."""


@njit(cache=True)
def solve(method, mode, alternating, reference, scan, guess, prior, descent, levels, search, still):
    """Answer (pose, Λ, pairs used, cost, iterations, converged), misfit, the distance [m] that a share of
    `FAR` of the pairs does not exceed, covariance (3, 3) in the body frame of the scan, eigenvalues (3,) of
    the information, and the number of answers compared.

    Arguments as in `slam.matching.estimate.estimate`; ``mode`` counts the covariance modes.
    """
    if alternating:
        pairs = np.full(len(scan[0][0]), -1, np.int64)
        answer = alternate(method, reference, scan, guess, descent, levels[-1, 0], pairs)
        fits, spread, tried = misfit(reference[0], scan[0], pairs, answer[0]), np.zeros((3, 3)), 1
    else:
        answer, pairs, fits, spread, tried = estimate(
            method, reference, scan, guess, prior, descent, levels, search, still
        )
    covariance, eigenvalues = body_covariance(
        mode, reference[0], scan[0], pairs, answer[0], answer[1], prior, spread, descent[1], descent[3]
    )
    far = residual_quantile(reference[0], scan[0], pairs, answer[0], FAR)
    return answer, fits, far, covariance, eigenvalues, tried
