"""The Cramér–Rao bound of a scan match, and how near to it the errors are.

Censi, "On achievable accuracy for range-finder localization" (2007): a beam from p along u that meets a
straight wall of normal n has ∂r/∂p = −n / (n·u) and ∂r/∂yaw = −r (n·Ju) / (n·u); Fisher's information is the
sum of gᵀg / σ². The walls are known there; here they are known from another scan as noisy as this one: 2 σ².
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from scenarios.bench.matching.pairs import Pair
from slam import se2
from slam.se2 import Array

SAME_SPOT = 1e-6
"""Ranges [m] nearer than this meet the same spot."""


def efficiency(pairs: Sequence[Pair], walls: Array, errors: Array) -> tuple[float, float]:
    """Bound over measured mean squared errors of translation and rotation, 1 is as good as can be: of matches
    with ``errors (N, 3)`` m, m, rad, of pairs seen among ``walls (S, 4)``.

    Only beams that meet what the reference sees too count in the bound: no matcher can use the others.
    """
    bounds = np.array([np.linalg.inv(pair_information(pair, walls)) for pair in pairs])
    possible = np.einsum("nii->i", bounds)
    squares = np.sum(errors**2, axis=0)
    return float(possible[:2].sum() / squares[:2].sum()), float(possible[2] / squares[2])


def pair_information(pair: Pair, walls: Array) -> Array:
    """Information ``(3, 3)`` that both scans of a pair hold about the pose, in the body frame of the
    second."""
    reference, pose = pair.poses
    gradients = range_gradients(walls, pose, pair.angles)
    ranges, _ = hits(walls, pose, pose[2] + pair.angles)
    spots = pose[:2] + ranges[:, None] * directions(pose[2] + pair.angles)
    toward = spots - reference[:2]
    bearing = se2.wrap(np.arctan2(toward[:, 1], toward[:, 0]) - reference[2])
    sight, _ = hits(walls, reference, reference[2] + bearing)
    half_beam = 0.5 * (pair.angles[1] - pair.angles[0])
    inside = (bearing > pair.angles[0] - half_beam) & (bearing < pair.angles[-1] + half_beam)
    shared = inside & (np.abs(sight - np.hypot(*toward.T)) < SAME_SPOT) & (ranges < pair.laser.range_max)
    return fisher_information(gradients[shared], np.sqrt(2.0) * pair.laser.sigma_range)


def fisher_information(gradients: Array, sigma: float) -> Array:
    """Information ``(3, 3)`` of ranges with deviation ``sigma`` m and ``gradients (B, 3)``."""
    return gradients.T @ gradients / sigma**2


def range_gradients(walls: Array, pose: Array, angles: Array) -> Array:
    """∂r/∂ξ ``(B, 3)`` of every beam for motion ξ of the body, T ∘ exp(ξ); NaN where nothing is met."""
    u = directions(pose[2] + angles)
    ranges, met = hits(walls, pose, pose[2] + angles)
    along = walls[met, 2:] - walls[met, :2]
    n = np.stack([-along[:, 1], along[:, 0]], -1) / np.hypot(*along.T)[:, None]
    across = np.sum(n * u, axis=1)
    by_yaw = -ranges * (n[:, 1] * u[:, 0] - n[:, 0] * u[:, 1]) / across
    return np.column_stack([-(n / across[:, None]) @ se2.rotation(pose[2]), by_yaw])


def hits(walls: Array, pose: Array, bearings: Array) -> tuple[Array, np.ndarray]:
    """Range ``(B,)`` m and wall ``(B,)`` that rays along world ``bearings (B,)`` meet first; inf for none."""
    u = directions(bearings)[:, None]
    a, e = walls[:, :2] - pose[:2], walls[:, 2:] - walls[:, :2]
    with np.errstate(divide="ignore", invalid="ignore"):  # rays along a wall do not meet it
        parallel = _cross(u, e)
        r, t = _cross(a, e) / parallel, _cross(a, u) / parallel
        ranges = np.where((r > 0.0) & (t >= 0.0) & (t <= 1.0), r, np.inf)
    met = np.argmin(ranges, axis=1)
    return ranges[np.arange(len(bearings)), met], met


def directions(bearings: Array) -> Array:
    """Unit vectors ``(B, 2)``."""
    return np.stack([np.cos(bearings), np.sin(bearings)], -1)


def _cross(a: Array, b: Array) -> Array:
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
