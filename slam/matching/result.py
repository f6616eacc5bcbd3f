"""What a matcher answers."""

from __future__ import annotations

from dataclasses import dataclass

from slam.se2 import Array


@dataclass(frozen=True)
class Match:
    """A relative pose and how sure the matcher is of it.

    ``T_reference_scan (3,)``; ``covariance (3, 3)`` in the body frame of the scan; ``information (3, 3)``
    of additive (x, y, yaw) errors in the reference frame, faded and possibly singular, for those who add
    it to other information; ``n_matches`` pairs of the last iteration; ``residual_rms`` √(Σ eᵀWe / (2n −
    3)); ``residual_p90`` m that nine of ten pairs are not farther apart than; ``misfit`` the mean over all
    points of the scan of χ² across the surface, cut at 9; ``information_eigenvalues (3,)`` of the scaled Λ,
    ascending; ``tried`` answers that were compared.
    """

    T_reference_scan: Array
    covariance: Array
    information: Array
    n_matches: int
    residual_rms: float
    residual_p90: float
    misfit: float
    iterations: int
    converged: bool
    information_eigenvalues: Array
    tried: int


@dataclass(frozen=True)
class NoMatch:
    """There is no answer, and why."""

    reason: str
    n_matches: int = 0
