"""Where is this scan, seen from that one? The answer with its covariance, or the reason why there is none."""

from __future__ import annotations

from typing import get_args

import numpy as np

from slam.matching.bias import Bias
from slam.matching.config import CovarianceMode, MatchConfig, Method
from slam.matching.reference import LocalMap, Reference
from slam.matching.registry import MATCHERS, OURS
from slam.matching.result import Match, NoMatch
from slam.scan import Scan
from slam.se2 import Array

DEFAULT = MatchConfig()
NO_PRIOR = np.zeros((3, 3))
COVARIANCES: tuple[str, ...] = get_args(CovarianceMode)


def match(
    reference: Scan | Reference | LocalMap,
    scan: Scan | Reference,
    guess: Array,
    method: Method = "plicp",
    covariance: CovarianceMode = "p2l",
    prior_information: Array | None = None,
    config: MatchConfig = DEFAULT,
    bias: Bias | None = None,
) -> Match | NoMatch:
    """Pose of ``scan`` in the frame of ``reference``, starting at ``guess (3,)``.

    ``prior_information (3, 3)`` weighs the guess itself (additive errors, reference frame); ``bias`` is what
    another sensor adds to the scan. ``wsm`` is the Gauss–Newton solution of Pfister's weighted cost (2002),
    ``plicp`` counts the component along the reference's normal only, weighted by both points' covariances,
    ``icp`` weighs all pairs alike; other names are those of `MATCHERS`, which heed neither ``covariance`` nor
    ``config``. Raises ``ValueError`` on a guess that is not three finite numbers or on an unknown method or
    covariance, ``TypeError`` when one of `MATCHERS` answers something else.
    """
    guess = _checked(guess, method, covariance)
    reference = Reference(reference) if isinstance(reference, Scan) else reference
    if bias is not None:
        scan = bias.removed(scan.scan if isinstance(scan, Reference) else scan)
    scan = Reference(scan) if isinstance(scan, Scan) else scan
    if len(reference) == 0 or len(scan) == 0:
        return NoMatch("a scan has no points")
    prior = NO_PRIOR if prior_information is None else np.asarray(prior_information, dtype=np.float64)
    if method in MATCHERS:
        return _asked(method, reference, scan, guess, prior)
    from slam.matching.kernels import ICP, PLICP, WSM
    from slam.matching.solve import solve

    number = {"wsm": WSM, "icp": ICP, "plicp": PLICP}[method]
    answer, fits, far, body, eigenvalues, tried = solve(
        number, COVARIANCES.index(covariance), config.solver == "alternating", reference.indexed,
        scan.indexed if config.mutual else scan.unindexed, guess, prior, config.descent,
        config.level_table, _window(config, prior), isinstance(reference, Reference),
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
        residual_p90=far,
        misfit=fits,
        iterations=iterations,
        converged=converged,
        information_eigenvalues=eigenvalues,
        tried=tried,
    )


def _checked(guess: Array, method: str, covariance: str) -> Array:
    guess = np.asarray(guess, dtype=np.float64)
    if guess.shape != (3,) or not np.isfinite(guess).all():
        raise ValueError(f"guess: expected three finite numbers x, y, yaw; got {guess!r}")
    if method not in OURS and method not in MATCHERS:
        raise ValueError(f"method: expected one of {(*OURS, *MATCHERS)}, got {method!r}")
    if covariance not in COVARIANCES:
        raise ValueError(f"covariance: expected one of {COVARIANCES}, got {covariance!r}")
    return guess


def _asked(
    name: str, reference: Reference | LocalMap, scan: Reference, guess: Array, prior: Array
) -> Match | NoMatch:
    """What a matcher from outside answers."""
    answer = MATCHERS[name](reference, scan, guess, prior)
    if not isinstance(answer, Match | NoMatch):
        raise TypeError(f"matcher {name!r}: expected a Match or a NoMatch, got {type(answer).__name__}")
    return answer


def _window(config: MatchConfig, prior: Array) -> tuple[float, ...]:
    """The search's settings, its window no wider than four standard deviations of the prior."""
    if not prior.any():
        return config.search
    (xx, xy, _), (_, yy, _), (_, _, turn) = prior
    known = 0.5 * (xx + yy) - np.hypot(0.5 * (xx - yy), xy), turn
    shift, turn = (4.0 / np.sqrt(value) if value > 0.0 else np.inf for value in known)
    return min(config.search[0], float(shift)), min(config.search[1], float(turn)), *config.search[2:]
