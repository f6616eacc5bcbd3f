"""What a matcher returns."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from slam import se2
from slam.matching.config import DEFAULT, MatchConfig
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
    information_eigenvalues: Array
    residual_rms: float = np.nan
    residual_p90: float = np.nan
    misfit: float = np.nan
    iterations: int = 0
    converged: bool = True
    tried: int = 1

    @classmethod
    def from_information(
        cls,
        T_reference_scan: Array,
        information: Array,
        n_matches: int,
        prior: Array | None = None,
        config: MatchConfig = DEFAULT,
    ) -> Match:
        """The result of a matcher that gives no more than this; what it does not give is NaN.

        ``information (3, 3)`` is that of the scans, ``prior (3, 3)`` what was known before: additive (x, y,
        yaw) errors in the reference frame. Of a direction that both leave open 1 m or 1 rad is claimed: of
        ``config``, ``least_information`` and ``length`` are read.
        Raises ``ValueError`` for shapes that differ or numbers that are not finite.
        """
        from slam.matching.covariance import floored_inverse

        pose, own = np.asarray(T_reference_scan, dtype=np.float64), np.array(information, dtype=np.float64)
        if pose.shape != (3,) or own.shape != (3, 3) or not np.isfinite([*pose, *own.ravel()]).all():
            raise ValueError(f"match: expected a finite pose (3,) and information (3, 3), got {pose}, {own}")
        known = own if prior is None else own + prior
        scale = np.array([1.0, 1.0, 1.0 / config.length])
        return cls(
            T_reference_scan=np.array([*pose[:2], se2.wrap(pose[2])]),
            covariance=se2.to_body_covariance(pose, floored_inverse(known, config.least_information)),
            information=own,
            n_matches=int(n_matches),
            information_eigenvalues=np.linalg.eigvalsh(known * np.outer(scale, scale)),
        )


@dataclass(frozen=True)
class NoMatch:
    """There is no answer, and why."""

    reason: str
    n_matches: int = 0
