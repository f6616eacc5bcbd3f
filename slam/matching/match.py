"""Where is this scan, seen from that one? The answer with its covariance, or the reason why there is none."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal, get_args

import numpy as np

from slam import se2
from slam.scan import Scan
from slam.se2 import Array

Method = Literal["wsm", "icp", "plicp"]
CovarianceMode = Literal["p2l", "joint"]

LEAST_INFORMATION = 1.0
"""Floor of the eigenvalues of the information: no direction is ever claimed worse than 1 m or 1 rad."""


@dataclass(frozen=True)
class MatchConfig:
    """Settings of the matcher.

    ``radii`` m are the correspondence distances, coarse to fine; ``robust`` the χ² at which a pair's
    weight has halved; ``mutual`` asks for mutual nearest neighbours; ``fade`` is the mean information
    below which a direction fades out (0: never); ``least_pairs`` the pairs an answer needs; ``sigma`` m
    weighs ICP's pairs.
    """

    radii: tuple[float, ...] = (0.5, 0.3)
    robust: float = 9.0
    mutual: bool = True
    fade: float = 0.0
    freeze_ratio: float = 1e-3
    most_iterations: int = 25
    least_pairs: int = 3
    sigma: float = 0.02
    length: float = 2.0


@dataclass(frozen=True)
class Match:
    """A relative pose and how sure the matcher is of it.

    ``T_reference_scan (3,)``; ``covariance (3, 3)`` in the body frame of the scan; ``information (3, 3)``
    of additive (x, y, yaw) errors in the reference frame, faded and possibly singular, for those who add
    it to other information; ``n_matches`` pairs of the last iteration; ``residual_rms`` √(Σ eᵀWe / (2n −
    3)); ``information_eigenvalues (3,)`` of the scaled Λ, ascending.
    """

    T_reference_scan: Array
    covariance: Array
    information: Array
    n_matches: int
    residual_rms: float
    iterations: int
    converged: bool
    information_eigenvalues: Array


@dataclass(frozen=True)
class NoMatch:
    """There is no answer, and why."""

    reason: str
    n_matches: int = 0


@dataclass(frozen=True)
class Reference:
    """Points to match against, with the index that finds them; build once, match many scans."""

    scan: Scan
    cell: float = 0.1

    @cached_property
    def index(self) -> Any:
        """Lattice index of the points."""
        from slam.matching.neighbours import build

        return build(self.scan.points, self.cell)

    @cached_property
    def arrays(self) -> tuple[Array, Array, Array, Array]:
        """Points, normals, covariances and tangent deviations, contiguous for the kernels."""
        s = self.scan
        parts = (s.points, s.normals, s.covariance, s.tangent_sigma)
        return tuple(np.ascontiguousarray(part) for part in parts)  # type: ignore[return-value]


def match(
    reference: Scan | Reference,
    scan: Scan | Reference,
    guess: Array,
    method: Method = "wsm",
    covariance: CovarianceMode = "p2l",
    prior_information: Array | None = None,
    config: MatchConfig = MatchConfig(),
) -> Match | NoMatch:
    """Pose of ``scan`` in the frame of ``reference``, starting at ``guess (3,)``.

    ``prior_information (3, 3)`` weighs the guess itself (additive errors, reference frame). The joint
    Gauss–Newton solution of Pfister's weighted cost (2002); ``icp`` weighs all pairs alike, ``plicp``
    counts the component along the reference's normal only. Raises ``ValueError`` on a guess that is not
    three finite numbers or an unknown method.
    """
    from slam.matching import kernels

    guess = np.asarray(guess, dtype=np.float64)
    if guess.shape != (3,) or not np.all(np.isfinite(guess)):
        raise ValueError(f"guess: expected three finite numbers x, y, yaw; got {guess!r}")
    if method not in get_args(Method):
        raise ValueError(f"method: expected one of {get_args(Method)}, got {method!r}")
    if covariance not in get_args(CovarianceMode):
        raise ValueError(f"covariance: expected one of {get_args(CovarianceMode)}, got {covariance!r}")
    reference = reference if isinstance(reference, Reference) else Reference(reference)
    scan = scan if isinstance(scan, Reference) else Reference(scan)
    if len(reference.scan) == 0 or len(scan.scan) == 0:
        return NoMatch("a scan has no points")
    prior = np.zeros((3, 3)) if prior_information is None else np.asarray(prior_information, dtype=np.float64)
    settings = (
        config.sigma, config.robust, float(config.mutual), config.length, config.fade,
        config.freeze_ratio, float(config.most_iterations),
    )  # fmt: skip
    pose, information, pairs, used, cost, iterations, converged = kernels.iterate(
        {"wsm": kernels.WSM, "icp": kernels.ICP, "plicp": kernels.PLICP}[method],
        reference.arrays, reference.index, scan.arrays, scan.index, guess, prior, settings,
        np.array(config.radii),
    )  # fmt: skip
    if used < config.least_pairs:
        return NoMatch(f"{used} pairs within {config.radii[-1]:g} m, needed {config.least_pairs}", used)
    additive = information + prior
    if covariance == "p2l":
        lines = kernels.point_to_line_information(reference.arrays, scan.arrays, pairs, pose, config.robust)
        additive = lines + prior
    return Match(
        T_reference_scan=np.array([pose[0], pose[1], float(se2.wrap(pose[2]))]),
        covariance=se2.to_body_covariance(pose, _inverse_floored(additive)),
        information=information,
        n_matches=used,
        residual_rms=float(np.sqrt(cost / max(2 * used - 3, 1))),
        iterations=iterations,
        converged=bool(converged),
        information_eigenvalues=_scaled_eigenvalues(additive, config.length),
    )


def _inverse_floored(information: Array) -> Array:
    """Λ⁻¹ with the eigenvalues of Λ floored, so that it is positive definite and at most 1 m or 1 rad."""
    values, vectors = np.linalg.eigh(0.5 * (information + information.T))
    return (vectors / np.maximum(values, LEAST_INFORMATION)) @ vectors.T


def _scaled_eigenvalues(information: Array, length: float) -> Array:
    scale = np.array([1.0, 1.0, 1.0 / length])
    return np.linalg.eigvalsh(information * np.outer(scale, scale))
