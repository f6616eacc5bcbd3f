"""The pose of a scan seen from another, with its covariance, or the reason why there is none."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from slam.matching.config import COVARIANCE_MODES, DEFAULT, CovarianceMode, MatchConfig, Method
from slam.matching.icp import IteratedMatcher
from slam.matching.reference import LocalMap, Reference
from slam.matching.registry import MATCHERS
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
    another sensor adds to the scan. ``method`` is a name in `MATCHERS`; ``covariance`` and ``config`` are
    read by ``wsm``, ``icp`` and ``plicp`` only (`slam.matching.icp`). Raises ``ValueError`` on a guess that
    is not three finite numbers or on an unknown method or covariance, ``TypeError`` when a matcher returns
    something else than a `Match` or a `NoMatch`.
    """
    guess = _checked(guess, method, covariance)
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


def _checked(guess: Array, method: str, covariance: str) -> Array:
    guess = np.asarray(guess, dtype=np.float64)
    if guess.shape != (3,) or not np.isfinite(guess).all():
        raise ValueError(f"guess: expected three finite numbers x, y, yaw; got {guess!r}")
    if method not in MATCHERS:
        raise ValueError(f"method: expected one of {tuple(MATCHERS)}, got {method!r}")
    if covariance not in COVARIANCE_MODES:
        raise ValueError(f"covariance: expected one of {COVARIANCE_MODES}, got {covariance!r}")
    return guess
