"""Poses of the plane as ``(..., 3)`` arrays ``(x, y, yaw)``, metres and radians.

``T_ab`` maps coordinates of frame b into frame a: ``p_a = R(yaw) p_b + (x, y)``. Tangent vectors are
``(x, y, yaw)`` in the body (right) frame, ``T_true = T ∘ exp(ξ)``, which is the convention of
``gtsam.Pose2`` 4.3 (its ``retract`` is ``Expmap``). All functions broadcast over leading dimensions.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.floating[Any]]

SMALL_ANGLE = 1e-4
"""Below this yaw [rad] exp and log use their Taylor series: the next term is under 1e-17."""


def _poses(T: ArrayLike) -> Array:
    T = np.asarray(T, dtype=np.float64)
    if T.ndim == 0 or T.shape[-1] != 3:
        raise ValueError(f"a pose is (..., 3): x, y, yaw; got shape {T.shape}")
    return T


def _split(T: ArrayLike) -> tuple[Array, Array, Array]:
    """x, y and yaw, each ``(...)``; of a single pose as numbers, which are quicker than arrays of one."""
    T = _poses(T)
    return (T[0], T[1], T[2]) if T.ndim == 1 else (T[..., 0], T[..., 1], T[..., 2])


def _joined(x: Array, y: Array, yaw: Array) -> Array:
    """What ``np.stack([x, y, yaw], -1)`` gives, at a fifth of its price for a single pose."""
    T = np.empty((*x.shape, 3))
    T[..., 0], T[..., 1], T[..., 2] = x, y, yaw
    return T


def wrap(angle: ArrayLike) -> Array:
    """Angle(s) [rad] wrapped to ``[-π, π)``."""
    return (np.asarray(angle, dtype=np.float64) + np.pi) % (2.0 * np.pi) - np.pi


def rotation(angle: ArrayLike) -> Array:
    """Rotation matrices ``(..., 2, 2)`` of angle(s) ``(...)`` [rad]."""
    angle = np.asarray(angle, dtype=np.float64)
    c, s = np.cos(angle), np.sin(angle)
    R = np.empty((*angle.shape, 2, 2))
    R[..., 0, 0], R[..., 0, 1] = c, -s
    R[..., 1, 0], R[..., 1, 1] = s, c
    return R


def compose(T_ab: ArrayLike, T_bc: ArrayLike) -> Array:
    """``T_ac = T_ab ∘ T_bc``, shapes ``(..., 3)``."""
    (x_ab, y_ab, yaw_ab), (x_bc, y_bc, yaw_bc) = _split(T_ab), _split(T_bc)
    c, s = np.cos(yaw_ab), np.sin(yaw_ab)
    return _joined(x_ab + c * x_bc - s * y_bc, y_ab + s * x_bc + c * y_bc, wrap(yaw_ab + yaw_bc))


def inverse(T_ab: ArrayLike) -> Array:
    """``T_ba``, shape ``(..., 3)``."""
    x, y, yaw = _split(T_ab)
    c, s = np.cos(yaw), np.sin(yaw)
    return _joined(-c * x - s * y, s * x - c * y, wrap(-yaw))


def between(T_ab: ArrayLike, T_ac: ArrayLike) -> Array:
    """Relative pose ``T_bc = T_ab⁻¹ ∘ T_ac``, shapes ``(..., 3)``."""
    (x_ab, y_ab, yaw_ab), (x_ac, y_ac, yaw_ac) = _split(T_ab), _split(T_ac)
    c, s = np.cos(yaw_ab), np.sin(yaw_ab)
    dx, dy = x_ac - x_ab, y_ac - y_ab
    return _joined(c * dx + s * dy, c * dy - s * dx, wrap(yaw_ac - yaw_ab))


def transform(T_ab: ArrayLike, points_b: ArrayLike) -> Array:
    """Points ``(..., n, 2)`` of frame b in frame a, for poses ``(..., 3)``."""
    T_ab, points_b = _poses(T_ab), np.asarray(points_b, dtype=np.float64)
    return points_b @ np.swapaxes(rotation(T_ab[..., 2]), -1, -2) + T_ab[..., None, :2]


def _left_jacobian_terms(yaw: Array) -> tuple[Array, Array]:
    """``sin(yaw)/yaw`` and ``(1-cos(yaw))/yaw``, finite at zero."""
    small = np.abs(yaw) < SMALL_ANGLE
    safe = np.where(small, 1.0, yaw)
    sinc = np.where(small, 1.0 - yaw**2 / 6.0, np.sin(safe) / safe)
    cosc = np.where(small, yaw / 2.0 - yaw**3 / 24.0, (1.0 - np.cos(safe)) / safe)
    return sinc, cosc


def exp(xi: ArrayLike) -> Array:
    """Pose ``(..., 3)`` reached by following the tangent vector ``ξ (..., 3)`` for unit time."""
    xi = _poses(xi)
    sinc, cosc = _left_jacobian_terms(xi[..., 2])
    x = sinc * xi[..., 0] - cosc * xi[..., 1]
    y = cosc * xi[..., 0] + sinc * xi[..., 1]
    return _joined(x, y, wrap(xi[..., 2]))


def log(T: ArrayLike) -> Array:
    """Tangent vector ``ξ (..., 3)`` with ``exp(ξ) = T`` and yaw in ``[-π, π)``."""
    T = _poses(T)
    yaw = wrap(T[..., 2])
    sinc, cosc = _left_jacobian_terms(yaw)
    scale = 1.0 / (sinc**2 + cosc**2)
    x = scale * (sinc * T[..., 0] + cosc * T[..., 1])
    y = scale * (sinc * T[..., 1] - cosc * T[..., 0])
    return _joined(x, y, yaw)


def adjoint(T: ArrayLike) -> Array:
    """Adjoint ``(..., 3, 3)`` with ``T ∘ exp(ξ) = exp(Ad(T) ξ) ∘ T``."""
    T = _poses(T)
    A = np.zeros((*T.shape, 3))
    A[..., :2, :2] = rotation(T[..., 2])
    A[..., 0, 2], A[..., 1, 2], A[..., 2, 2] = T[..., 1], -T[..., 0], 1.0
    return A


def transport(covariance: ArrayLike, T: ArrayLike) -> Array:
    """``Ad(T) Σ Ad(T)ᵀ``: a covariance ``(..., 3, 3)`` of ξ_b expressed in frame a, for ``T = T_ab``."""
    A = adjoint(T)
    return A @ np.asarray(covariance, dtype=np.float64) @ np.swapaxes(A, -1, -2)


def compose_covariance(covariance_ab: ArrayLike, T_bc: ArrayLike, covariance_bc: ArrayLike) -> Array:
    """Covariance ``(..., 3, 3)`` of ``T_ab ∘ T_bc`` to first order: ``Ad(T_bc⁻¹) Σ_ab Ad(T_bc⁻¹)ᵀ +
    Σ_bc``."""
    return transport(covariance_ab, inverse(T_bc)) + np.asarray(covariance_bc, dtype=np.float64)


def to_body_covariance(T: ArrayLike, covariance: ArrayLike) -> Array:
    """Right-tangent covariance ``(..., 3, 3)`` from one of additive ``(x, y, yaw)`` errors of ``T``."""
    T = _poses(T)
    B = np.zeros((*T.shape[:-1], 3, 3))
    B[..., :2, :2] = np.swapaxes(rotation(T[..., 2]), -1, -2)
    B[..., 2, 2] = 1.0
    return B @ np.asarray(covariance, dtype=np.float64) @ np.swapaxes(B, -1, -2)


@cache
def max_distance(confidence: float) -> float:
    """Squared Mahalanobis distance of poses that lie within it with probability ``confidence``: χ²₃."""
    from scipy.stats import chi2

    return float(chi2.ppf(confidence, 3))


def path_length(poses: ArrayLike) -> Array:
    """Distance travelled [m] up to each of the poses ``(N, 3)``, shape ``(N,)``, starting at 0."""
    steps = np.linalg.norm(np.diff(_poses(poses)[:, :2], axis=0), axis=1)
    return np.concatenate([[0.0], np.cumsum(steps)])


def fit_rigid(source: ArrayLike, target: ArrayLike, weights: ArrayLike | None = None) -> Array:
    """Pose ``T_target_source (3,)`` that moves points ``source (n, 2)`` onto ``target (n, 2)`` with the least
    squared error, weighed by ``weights (n,)``, without scale (Umeyama 1991, doi:10.1109/34.88573).

    Where the points of either set coincide, any rotation fits: yaw is then 0. Raises ``ValueError`` unless
    both are ``(n, 2)`` with n > 0.
    """
    source, target = np.asarray(source, dtype=np.float64), np.asarray(target, dtype=np.float64)
    if source.shape != target.shape or source.ndim != 2 or source.shape[1] != 2 or len(source) == 0:
        raise ValueError(f"rigid fit: expected two (n, 2) with n > 0, got {source.shape} and {target.shape}")
    share = np.ones(len(source)) if weights is None else np.asarray(weights, dtype=np.float64)
    share = share[:, None] / share.sum()
    centre_source, centre_target = np.sum(share * source, axis=0), np.sum(share * target, axis=0)
    p, q = source - centre_source, target - centre_target
    pull = share * q
    yaw = float(np.arctan2(np.sum(p[:, 0] * pull[:, 1] - p[:, 1] * pull[:, 0]), np.sum(p * pull)))
    return np.array([*(centre_target - rotation(yaw) @ centre_source), yaw])
