"""The matchers wsm, icp and plicp: nearest neighbours and Gauss-Newton steps in turn, one loop for all.

They differ in the weight of a pair of points: the inverse of both points' covariances (the Weighted Scan
Matcher of Pfister et al. 2002), a constant (Besl & McKay 1992), or along the reference's normal only,
weighted by both points' covariances (Censi 2008).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from slam.matching.config import COVARIANCE_MODES, DEFAULT, CovarianceMode, MatchConfig
from slam.matching.reference import LocalMap, Reference
from slam.matching.result import Match, NoMatch
from slam.se2 import Array


@dataclass(frozen=True)
class IteratedMatcher:
    """One of the three by its pair ``weight``: `slam.matching.config.WSM`, ``ICP`` or ``PLICP``."""

    weight: int

    def __call__(
        self,
        reference: Reference | LocalMap,
        scan: Reference,
        guess: Array,
        prior: Array,
        config: MatchConfig = DEFAULT,
        covariance: CovarianceMode = "p2l",
    ) -> Match | NoMatch:
        """As a `slam.matching.registry.Matcher`, with settings and the kind of covariance."""
        from slam.matching.search import solve

        answer, misfit, residual_p90, body, eigenvalues, tried = solve(
            self.weight, COVARIANCE_MODES.index(covariance), config.solver == "alternating",
            reference.indexed, scan.indexed if config.mutual else scan.unindexed, guess, prior,
            _settings(config, prior), config.level_table, isinstance(reference, Reference),
        )  # fmt: skip
        pose, information, used, cost, iterations, converged = answer
        if used < config.least_pairs:
            return NoMatch(f"{used} pairs within {config.radius:g} m, needed {config.least_pairs}", used)
        if not np.isfinite(body).all():
            return NoMatch(f"{used} pairs do not determine a pose", used)
        return Match(
            T_reference_scan=np.array([pose[0], pose[1], (pose[2] + np.pi) % (2.0 * np.pi) - np.pi]),
            covariance=body,
            information=information,
            n_matches=used,
            residual_rms=float(np.sqrt(cost / max(2 * used - 3, 1))),
            residual_p90=residual_p90,
            misfit=misfit,
            iterations=iterations,
            converged=converged,
            information_eigenvalues=eigenvalues,
            tried=tried,
        )


def _settings(config: MatchConfig, prior: Array) -> tuple[float, ...]:
    """The kernels' settings, the search no wider than ``prior_sigmas`` of the prior ``(3, 3)``."""
    settings = config.kernel_settings
    if not prior.any():
        return settings
    (xx, xy, _), (_, yy, _), (_, _, turn) = prior
    known = 0.5 * (xx + yy) - np.hypot(0.5 * (xx - yy), xy), turn
    sigmas = config.prior_sigmas
    shift, turn = (float(sigmas / np.sqrt(value)) if value > 0.0 else np.inf for value in known)
    narrow = min(settings.search_shift, shift), min(settings.search_turn, turn)
    return settings._replace(search_shift=narrow[0], search_turn=narrow[1])
