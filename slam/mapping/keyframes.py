"""Keyframes: the scans that stand for the drive, and how the others follow them."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from slam import se2
from slam.se2 import Array


@dataclass(frozen=True)
class KeyframeConfig:
    """A scan becomes a keyframe …"""

    distance: float = 0.15
    """… this far [m] from the last one …"""
    angle: float = np.radians(7.0)
    """… or turned by this [rad]."""


def choose(poses: Array, config: KeyframeConfig = KeyframeConfig()) -> np.ndarray:
    """Indices ``(K,)`` of the keyframes among poses ``(N, 3)``; the first and the last are always among
    them."""
    distance, angle = config.distance, config.angle
    chosen = [0]
    x, y, yaw = poses[0].tolist()
    for k, (x_k, y_k, yaw_k) in enumerate(poses.tolist()):  # plain numbers: a call of numpy's costs more
        turn = (yaw_k - yaw + math.pi) % math.tau - math.pi
        if math.hypot(x_k - x, y_k - y) >= distance or abs(turn) >= angle:
            x, y, yaw = x_k, y_k, yaw_k
            chosen.append(k)
    if chosen[-1] != len(poses) - 1:
        chosen.append(len(poses) - 1)
    return np.array(chosen)


def nearest(rows: np.ndarray, n: int) -> np.ndarray:
    """Position in ``rows (K,)`` of the keyframe nearest in the drive to each of n scans, shape ``(n,)``."""
    after = np.clip(np.searchsorted(rows, np.arange(n)), 1, max(len(rows) - 1, 1))
    before_is_nearer = np.arange(n) - rows[after - 1] <= rows[np.minimum(after, len(rows) - 1)] - np.arange(n)
    return np.where(before_is_nearer, after - 1, np.minimum(after, len(rows) - 1))


def carry(poses: Array, rows: np.ndarray, corrected: Array) -> Array:
    """All poses ``(N, 3)`` after the poses at ``rows (K,)`` became ``corrected (K, 3)``.

    The correction between two rows is spread along the path travelled between them; before the first and
    after the last row it is that row's own.
    """
    path = se2.path_length(poses) + 1e-9 * np.arange(len(poses))
    before = np.clip(np.searchsorted(rows, np.arange(len(poses)), side="right") - 1, 0, len(rows) - 1)
    after = np.minimum(before + 1, len(rows) - 1)
    moved = se2.compose(corrected[before], se2.between(poses[rows[before]], poses))
    target = se2.compose(corrected[before], se2.between(poses[rows[before]], poses[rows[after]]))
    gap = path[rows[after]] - path[rows[before]]
    share = np.where(gap > 0.0, (path - path[rows[before]]) / np.where(gap > 0.0, gap, 1.0), 0.0)
    residual = se2.log(se2.between(target, corrected[after]))
    carried = se2.compose(moved, se2.exp(np.clip(share, 0.0, 1.0)[:, None] * residual))
    carried[rows] = corrected
    return carried
