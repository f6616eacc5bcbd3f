"""The pose of a scan seen from another, with its covariance, or why there is none; the matchers by name.

The matchers wsm, icp and plicp are one loop: nearest neighbours and Gauss-Newton steps in turn. They differ
in the weight of a pair of points: the inverse of both points' covariances (the Weighted Scan Matcher of
Pfister et al. 2002), a constant (Besl & McKay 1992), or along the reference's normal only, weighted by both
points' covariances (Censi 2008).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from importlib import import_module

import numpy as np

from slam.matching.config import COVARIANCE_MODES, DEFAULT, ICP, PLICP, WSM, CovarianceMode, MatchConfig
from slam.matching.reference import LocalMap, Reference
from slam.matching.result import Match, NoMatch
from slam.scan import Scan
from slam.se2 import Array

NO_PRIOR = np.zeros((3, 3))


@dataclass(frozen=True)
class Bias:
    """Offset of a scan's points against what the reference's sensor would have measured (Pfister 2002).

    ``mean`` m and ``covariance`` m² are in the frame of the scan, ``(2,)`` and ``(2, 2)`` for all points
    alike, or ``(n, 2)`` and ``(n, 2, 2)``. Two scans of one sensor have none.
    """

    mean: Array
    covariance: Array

    @classmethod
    def of_range(cls, scan: Scan, mean: float, sigma: float, origin: Array = (0.0, 0.0)) -> Bias:  # type: ignore[assignment]
        """Ranges too long by ``mean`` ± ``sigma`` m, measured from ``origin (2,)`` in the scan's frame."""
        beams = scan.points - np.asarray(origin)
        beams /= np.linalg.norm(beams, axis=1, keepdims=True)
        return cls(mean * beams, sigma**2 * beams[:, :, None] * beams[:, None, :])

    def correct(self, scan: Scan) -> Scan:
        """The scan without the mean offset, its points less certain. Raises ``ValueError`` on a shape that
        does not fit the scan."""
        n = len(scan)
        if np.shape(self.mean) not in ((2,), (n, 2)) or np.shape(self.covariance) not in ((2, 2), (n, 2, 2)):
            raise ValueError(
                f"bias: expected (2,) or ({n}, 2) and (2, 2) or ({n}, 2, 2), "
                f"got {np.shape(self.mean)} and {np.shape(self.covariance)}"
            )
        return replace(scan, points=scan.points - self.mean, covariance=scan.covariance + self.covariance)


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
        """As a `Matcher`, with settings and the kind of covariance."""
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


Matcher = Callable[[Reference | LocalMap, Reference, Array, Array], Match | NoMatch]
"""``(reference, scan, guess (3,), prior (3, 3))`` to the pose of the scan in the frame of the reference.

The prior is information about the guess (additive errors, reference frame), zero where there is none.
"""

MATCHERS: dict[str, Matcher] = {
    "wsm": IteratedMatcher(WSM),
    "icp": IteratedMatcher(ICP),
    "plicp": IteratedMatcher(PLICP),
}
"""Name → matcher, which may be the ``method`` of a match or of a front end. A further one is a file of its
own and an entry here; `tests/slam/matching/test_registry.py` tries it on arrival."""


def register(name: str) -> str:
    """The name, after importing and registering the matcher if it is a ``module:function`` not known yet.

    Raises ``ValueError`` saying what is wrong with it.
    """
    if name in MATCHERS:
        return name
    module, _, function = name.partition(":")
    if not function:
        known = ", ".join(MATCHERS)
        raise ValueError(f"unknown matcher {name!r}: expected one of {known}, or MODULE:FUNCTION")
    try:
        matcher = getattr(import_module(module), function)
    except (ImportError, AttributeError) as error:
        raise ValueError(f"matcher {name!r}: {error}") from error
    if not callable(matcher):
        raise ValueError(f"matcher {name!r}: expected a function, got {type(matcher).__name__}")
    MATCHERS[name] = matcher
    return name


def match(
    reference: Scan | Reference | LocalMap,
    scan: Scan | Reference,
    guess: Array,
    method: str = "plicp",
    covariance: CovarianceMode = "p2l",
    prior_information: Array | None = None,
    config: MatchConfig = DEFAULT,
    bias: Bias | None = None,
) -> Match | NoMatch:
    """Pose of ``scan`` in the frame of ``reference``, starting at ``guess (3,)``.

    ``prior_information (3, 3)`` weighs the guess itself (additive errors, reference frame); ``bias`` is what
    another sensor adds to the scan. ``method`` is a name in `MATCHERS`; ``covariance`` and ``config`` are
    read by ``wsm``, ``icp`` and ``plicp`` only. Raises ``ValueError`` on a guess that
    is not three finite numbers or on an unknown method or covariance, ``TypeError`` when a matcher returns
    something else than a `Match` or a `NoMatch`.
    """
    guess = np.asarray(guess, dtype=np.float64)
    if guess.shape != (3,) or not np.isfinite(guess).all():
        raise ValueError(f"guess: expected three finite numbers x, y, yaw; got {guess!r}")
    if method not in MATCHERS:
        raise ValueError(f"method: expected one of {tuple(MATCHERS)}, got {method!r}")
    if covariance not in COVARIANCE_MODES:
        raise ValueError(f"covariance: expected one of {COVARIANCE_MODES}, got {covariance!r}")
    reference = Reference(reference) if isinstance(reference, Scan) else reference
    if bias is not None:
        scan = bias.correct(scan.scan if isinstance(scan, Reference) else scan)
    scan = Reference(scan) if isinstance(scan, Scan) else scan
    if len(reference) == 0 or len(scan) == 0:
        return NoMatch("a scan has no points")
    prior = NO_PRIOR if prior_information is None else np.asarray(prior_information, dtype=np.float64)
    matcher = MATCHERS[method]
    if isinstance(matcher, IteratedMatcher):
        return matcher(reference, scan, guess, prior, config, covariance)
    answer = matcher(reference, scan, guess, prior)
    if not isinstance(answer, Match | NoMatch):
        raise TypeError(f"matcher {method!r}: expected a Match or a NoMatch, got {type(answer).__name__}")
    return answer
