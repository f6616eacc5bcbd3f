"""Pose errors of a drive against truth, absolute and relative (Sturm et al. 2012), as evo computes them;
whether a method's covariance tells the truth about them; and what was answered on the way."""

from __future__ import annotations

import numpy as np
from scipy.stats import chi2, norm

from scenarios.evaluation.metric import NO_TRUTH, Definition, Values, absent
from slam import se2
from slam.se2 import Array
from stitch.mapping.estimate import OnlineResult

RPE_LENGTHS = (1, 10)
"""Travelled distances [m] of the relative pose errors."""
RPE_TOLERANCE = 0.1
"""How far, as a share of the length, a pair may be from the wanted travelled distance."""

_BENT = "A bent map: the alignment spreads an error made at one place over the whole drive."
_TAIL = "Where the error happened, and how most of the drive fared: one bad place rules it."
_ANCHORED = "How good the map is apart from its first heading: a small yaw error there grows with distance."
_LOCAL = (
    "Whether the map closes: errors beyond the window do not count, nor do windows where the robot stood."
)
_WAITING = "How long a scan waits for those before it when these take longer than the next one needs to come."
_JUMP = "How far a pose that was given early jumped when a loop closed later."
_GIVEN = "position error after SE(2) alignment of each pose as given when its scan arrived, RMSE"
_CHANCE = "Chance: poses of one drive share their errors, so only many drives make a test of it."
_HALF = "The worse half of the poses."
_CRPS = "continuous ranked probability score of the stated distribution"
_SCORED = "Whether error or honesty is bad: it is small where both are good; and how the axes hang together."
_ATE = "position error after SE(2) alignment"

DEFINITIONS = {
    "ate_rmse": Definition("m", "lower", f"{_ATE}, RMSE", _BENT),
    "ate_median": Definition("m", "lower", f"{_ATE}, median", "The worse half of the drive."),
    "ate_max": Definition("m", "lower", f"{_ATE}, largest", _TAIL),
    "ate_rmse_anchored": Definition(
        "m", "lower", "position error in the frame of the first pose, RMSE", _ANCHORED
    ),
    "yaw_rmse": Definition("deg", "lower", "heading error after the same alignment, RMSE", _BENT),
} | {
    f"rpe_{part}_{length}m": Definition(
        unit, "lower", f"{word} error over {length} m of driving, RMSE", _LOCAL
    )
    for length in RPE_LENGTHS
    for part, unit, word in (("trans", "m", "translation"), ("rot", "deg", "rotation"))
}
CONSISTENCY = {
    "anees": Definition("", None, "squared error over its stated covariance, / 3; 1 is honest", _CHANCE),
    "anees_k": Definition("", None, "median of the same over that of χ²₃; 1 is honest", f"{_CHANCE} {_HALF}"),
    "crps_trans": Definition("m", "lower", f"{_CRPS}, mean over x and y", _SCORED),
    "crps_rot": Definition("deg", "lower", f"{_CRPS} of the heading", _SCORED),
}
ONLINE = {
    "ate_online": Definition("m", "lower", _GIVEN, _JUMP),
    "latency_median": Definition("ms", "lower", "from a scan's arrival to its pose, median", _WAITING),
    "latency_p99": Definition("ms", "lower", "from a scan's arrival to its pose, 99th percentile", _WAITING),
    "latency_max": Definition("ms", "lower", "from a scan's arrival to its pose, longest", _WAITING),
}


def align(poses: Array, truth: Array) -> Array:
    """``T_truth_estimate (3,)`` that aligns positions, least squares without scale (Umeyama 1991). ``poses``
    and ``truth`` are ``(N, 3)``. Where the positions do not fix a rotation (a robot that stood still) the
    headings do. Raises ``ValueError`` when the shapes differ or a pose is not finite."""
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


def aligned(poses: Array, truth: Array | None) -> Array:
    """``poses (N, 3)`` moved onto ``truth (N, 3)`` by `align`; as they are without truth."""
    return poses if truth is None else se2.compose(align(poses, truth), poses)


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


def trajectory_metrics(poses: Array, truth: Array | None) -> Values:
    """ATE, heading error and RPE of ``poses (N, 3)``; without ``truth`` the reason why there are none."""
    if truth is None:
        return absent(DEFINITIONS, NO_TRUTH)
    best = aligned(poses, truth)
    anchored = se2.compose(truth[0], se2.between(poses[0], poses))
    distance = np.linalg.norm(best[:, :2] - truth[:, :2], axis=1)
    values: Values = {
        "ate_rmse": _rms(distance),
        "ate_median": float(np.median(distance)),
        "ate_max": float(distance.max()),
        "ate_rmse_anchored": _rms(np.linalg.norm(anchored[:, :2] - truth[:, :2], axis=1)),
        "yaw_rmse": float(np.degrees(_rms(se2.wrap(best[:, 2] - truth[:, 2])))),
    }
    for length in RPE_LENGTHS:
        names = f"rpe_trans_{length}m", f"rpe_rot_{length}m"
        pairs = travelled_pairs(truth, length)
        if len(pairs) == 0:
            values |= absent(names, f"no two scans lie {length} m of driving apart")
            continue
        translation, rotation = relative_errors(poses, truth, pairs)
        values |= {names[0]: _rms(translation), names[1]: float(np.degrees(_rms(rotation)))}
    return values


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))


def online_metrics(online: OnlineResult | None, truth: Array | None) -> Values:
    """Error of the poses as given on the way, and how long each scan took [ms]."""
    if online is None:
        return absent(ONLINE, "the method answers when the drive is over")
    milliseconds = 1e3 * online.seconds
    error: float | str = NO_TRUTH
    if truth is not None:
        off = aligned(online.poses, truth)[:, :2] - truth[:, :2]
        error = float(np.sqrt(np.mean(np.sum(off**2, axis=1))))
    return {
        "ate_online": error,
        "latency_median": float(np.median(milliseconds)),
        "latency_p99": float(np.percentile(milliseconds, 99.0)),
        "latency_max": float(milliseconds.max()),
    }


def consistency_metrics(poses: Array, covariance: Array | None, truth: Array | None) -> Values:
    """Normalised estimation error squared, its average over 3 and its median over that of χ² with 3 degrees
    of freedom: above 1 is over-confident, below 1 timid; and the CRPS of the stated distribution, which is
    the absolute error of one that states no doubt."""
    if covariance is None:
        return absent(CONSISTENCY, "the method states no covariance of its poses")
    if truth is None:
        return absent(CONSISTENCY, NO_TRUTH)
    error, sigma = _usable_errors(poses, covariance, truth)
    if len(error) == 0:
        return absent(CONSISTENCY, "no pose has a usable covariance")
    nees = _mahalanobis(error, sigma)
    score = crps(error, np.sqrt(np.diagonal(sigma, axis1=1, axis2=2))).mean(axis=0)
    return {
        "anees": nees.mean() / 3.0,
        "anees_k": float(np.median(nees) / chi2.median(3)),
        "crps_trans": float(score[:2].mean()),
        "crps_rot": float(np.degrees(score[2])),
    }


def crps(error: Array, sigma: Array) -> Array:
    """Continuous ranked probability score of a normal distribution whose mean is off by ``error`` and whose
    standard deviation is ``sigma``, in their unit (Gneiting & Raftery 2007, after eq. 20)."""
    z = error / sigma
    score: Array = sigma * (z * (2.0 * norm.cdf(z) - 1.0) + 2.0 * norm.pdf(z) - 1.0 / np.sqrt(np.pi))
    return score


def squared_errors(poses: Array, covariance: Array, truth: Array) -> Array:
    """Normalised estimation errors squared ``(K,)``, expected 3 each, of `_usable_errors`."""
    return _mahalanobis(*_usable_errors(poses, covariance, truth))


def _usable_errors(poses: Array, covariance: Array, truth: Array) -> tuple[Array, Array]:
    """Errors ``(K, 3)`` of poses and their covariances ``(K, 3, 3)``.

    Poses ``(N, 3)`` and ``truth (N, 3)`` are taken relative to their first, because a map has no frame of its
    own; the error of each is in its body tangent, as ``covariance (N, 3, 3)`` is. The first pose, and those
    whose covariance is not finite or not positive definite, are left out.
    """
    error = se2.log(se2.between(se2.between(poses[0], poses), se2.between(truth[0], truth)))[1:]
    sigma = covariance[1:]
    usable = np.all(np.isfinite(sigma), axis=(1, 2))
    usable[usable] = np.linalg.eigvalsh(sigma[usable])[:, 0] > 0.0
    return error[usable], sigma[usable]


def _mahalanobis(error: Array, sigma: Array) -> Array:
    return np.einsum("ni,ni->n", error, np.linalg.solve(sigma, error[..., None])[..., 0])


def last_squared_error(poses: Array, covariance: Array | None, truth: Array) -> float:
    """Normalised estimation error squared of the last pose, expected 3; NaN where no covariance is usable.
    One number per drive: over many drives these are independent, which the poses of one drive are not."""
    if covariance is None:
        return float("nan")
    ends = [0, -1]
    nees = squared_errors(poses[ends], covariance[ends], truth[ends])
    return float(nees[0]) if len(nees) else float("nan")


def band(runs: int, probability: float = 0.95) -> tuple[float, float]:
    """Interval that holds the average of ``runs`` independent squared errors, / 3, of an honest covariance.
    χ² with ``3 runs`` degrees of freedom (Bar-Shalom, Li & Kirubarajan 2001, §5.4). Raises ``ValueError`` for
    no runs."""
    if runs < 1:
        raise ValueError(f"band: expected one run or more, got {runs}")
    tail, freedom = (1.0 - probability) / 2.0, 3 * runs
    return float(chi2.ppf(tail, freedom)) / freedom, float(chi2.ppf(1.0 - tail, freedom)) / freedom
