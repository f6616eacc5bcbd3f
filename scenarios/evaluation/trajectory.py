"""Absolute and relative pose errors of a drive against truth (Sturm et al. 2012), as evo computes them."""

from __future__ import annotations

import numpy as np

from scenarios.evaluation.metric import Metric, measured, missing
from slam import se2
from slam.se2 import Array

ABSOLUTE = ("ate_rmse", "ate_median", "ate_max", "ate_rmse_anchored", "yaw_rmse")
RPE_LENGTHS = (1, 10)
"""Travelled distances [m] of the relative pose errors."""
RPE_TOLERANCE = 0.1
"""How far, as a share of the length, a pair may be from the wanted travelled distance."""


def align(poses: Array, truth: Array) -> Array:
    """``T_truth_estimate (3,)`` that aligns positions, least squares without scale (Umeyama 1991).

    ``poses`` and ``truth`` are ``(N, 3)``. Where the positions do not fix a rotation (a robot that stood
    still) the headings do. Raises ``ValueError`` when the shapes differ or a pose is not finite.
    """
    if poses.shape != truth.shape or poses.ndim != 2 or poses.shape[1:] != (3,):
        raise ValueError(f"alignment: expected two (N, 3), got {poses.shape} and {truth.shape}")
    if not (np.all(np.isfinite(poses)) and np.all(np.isfinite(truth))):
        raise ValueError("alignment: expected finite poses")
    mean_pose, mean_truth = poses[:, :2].mean(axis=0), truth[:, :2].mean(axis=0)
    a, b = poses[:, :2] - mean_pose, truth[:, :2] - mean_truth
    cross, dot = np.sum(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]), np.sum(a * b)
    if np.hypot(cross, dot) > 1e-12:
        yaw = np.arctan2(cross, dot)
    else:
        turn = truth[:, 2] - poses[:, 2]
        yaw = np.arctan2(np.sin(turn).sum(), np.cos(turn).sum())
    return np.array([*(mean_truth - se2.rotation(yaw) @ mean_pose), yaw])


def aligned(poses: Array, truth: Array) -> Array:
    """``poses (N, 3)`` moved onto ``truth (N, 3)`` by `align`."""
    return se2.compose(align(poses, truth), poses)


def travelled_pairs(truth: Array, length: float, tolerance: float = RPE_TOLERANCE) -> np.ndarray:
    """Index pairs ``(K, 2)`` of poses that lie ``length`` metres of driving apart along ``truth (N, 3)``.

    For each i, the later j whose travelled distance from i is nearest to ``length`` (the first such j), left
    out where that is off by more than ``tolerance * length``: near the end, and where scans are sparse.
    These are the pairs of evo's RPE with ``delta_unit=meters, all_pairs=True, pairs_from_reference=True``.
    """
    travelled = se2.path_length(truth)
    pairs = []
    for i in range(len(truth) - 1):
        off = np.abs(travelled[i + 1 :] - travelled[i] - length)
        nearest = int(np.argmin(off))
        if off[nearest] <= tolerance * length:
            pairs.append((i, i + 1 + nearest))
    return np.array(pairs, dtype=np.int64).reshape(-1, 2)


def relative_errors(poses: Array, truth: Array, pairs: np.ndarray) -> tuple[Array, Array]:
    """Translation [m] and rotation [rad] error ``(K,)`` of the relative poses of ``pairs (K, 2)``."""
    i, j = pairs.T
    error = se2.between(se2.between(truth[i], truth[j]), se2.between(poses[i], poses[j]))
    return np.hypot(error[:, 0], error[:, 1]), np.abs(error[:, 2])


def trajectory_metrics(method: str, poses: Array, truth: Array | None) -> list[Metric]:
    """ATE, heading error and RPE of ``poses (N, 3)``; without ``truth`` the reason why there are none."""
    if truth is None:
        names = ABSOLUTE + tuple(name for length in RPE_LENGTHS for name in _rpe_names(length))
        return missing(method, names, "the recording has no truth")
    metrics = _absolute(method, poses, truth)
    for length in RPE_LENGTHS:
        metrics += _relative(method, poses, truth, length)
    return metrics


def _absolute(method: str, poses: Array, truth: Array) -> list[Metric]:
    best = aligned(poses, truth)
    anchored = se2.compose(truth[0], se2.between(poses[0], poses))
    distance = _distance(best, truth)
    values = (
        _rms(distance),
        float(np.median(distance)),
        float(distance.max()),
        _rms(_distance(anchored, truth)),
        float(np.degrees(_rms(se2.wrap(best[:, 2] - truth[:, 2])))),
    )
    return measured(method, dict(zip(ABSOLUTE, values, strict=True)))


def _relative(method: str, poses: Array, truth: Array, length: int) -> list[Metric]:
    names = _rpe_names(length)
    pairs = travelled_pairs(truth, length)
    if len(pairs) == 0:
        return missing(method, names, f"no two scans lie {length} m of driving apart")
    translation, rotation = relative_errors(poses, truth, pairs)
    return measured(method, {names[0]: _rms(translation), names[1]: float(np.degrees(_rms(rotation)))})


def _rpe_names(length: int) -> tuple[str, str]:
    return f"rpe_trans_{length}m", f"rpe_rot_{length}m"


def _distance(poses: Array, truth: Array) -> Array:
    return np.linalg.norm(poses[:, :2] - truth[:, :2], axis=1)


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))
