"""Wheel odometry of a tracked robot: encoders count what the tracks turn, not what the ground gives back."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import ArrayLike

from slam.se2 import Array


@dataclass(frozen=True)
class OdometryConfig:
    """How the tracks slip, and what the estimator believes of them.

    A track loses the share ``slip + slip_per_tilt · |sin tilt| + burst`` of what it turns, at most 0.95;
    bursts are a two-state Markov chain of each track. Raises ``ValueError`` for negative values.
    """

    slip: float = 0.02
    """Share that is always lost."""
    slip_per_tilt: float = 0.5
    """Share that is lost on ground that stands upright."""
    burst: float = 0.1
    """Share that is lost in a burst."""
    burst_rate: float = 0.02
    """Bursts that begin [1/s]."""
    burst_end_rate: float = 1.0
    """One over their mean duration [1/s]."""
    skid_ratio: float = 1.4
    """How many times faster than the body the estimator takes the tracks' difference to turn: 1 is plain
    differential drive, the robot's own value is perfect calibration."""

    def __post_init__(self) -> None:
        for f in fields(self):
            if not getattr(self, f.name) >= 0.0:
                raise ValueError(f"odometry {f.name}: expected >= 0, got {getattr(self, f.name)}")
        if not self.skid_ratio > 0.0:
            raise ValueError("odometry skid_ratio: expected > 0")


def slips(tilt: ArrayLike, time: ArrayLike, config: OdometryConfig, rng: np.random.Generator) -> Array:
    """Share ``(M - 1, 2)`` that the left and the right track lose between readings at ``time (M,)`` s.

    ``tilt (M, 2)``: roll and pitch rad; the angle to the vertical counts.
    """
    tilt, dt = np.asarray(tilt, dtype=np.float64), np.diff(np.asarray(time, dtype=np.float64))
    cos_tilt = np.cos(tilt[1:, 0]) * np.cos(tilt[1:, 1])
    steady = config.slip + config.slip_per_tilt * np.sqrt(np.maximum(0.0, 1.0 - cos_tilt**2))
    bursting = np.zeros((len(dt), 2), dtype=bool)
    chance = rng.random((len(dt), 2))
    now = np.zeros(2, dtype=bool)
    for k, step in enumerate(dt):
        rate = np.where(now, config.burst_end_rate, config.burst_rate)
        now = now ^ (chance[k] < 1.0 - np.exp(-rate * step))
        bursting[k] = now
    return np.clip(steady[:, None] + config.burst * bursting, 0.0, 0.95)


def dead_reckon(
    start: ArrayLike,
    tracks: ArrayLike,
    tilt: ArrayLike,
    time: ArrayLike,
    gauge: float,
    config: OdometryConfig,
    rng: np.random.Generator,
) -> Array:
    """Poses ``(M, 3)`` from ``start (3,)`` as the encoders have it, yaw not wrapped.

    ``tracks (M, 2)`` m: what left and right track have driven so far on firm ground, pushing at a wall or
    not; on the real ground they slip, and count more for the same motion. ``gauge`` m between the tracks,
    ``tilt (M, 2)`` rad and ``time (M,)`` s as in `slips`.
    """
    start, tracks = np.asarray(start, dtype=np.float64), np.asarray(tracks, dtype=np.float64)
    counted = np.diff(tracks, axis=0) / (1.0 - slips(tilt, time, config, rng))
    forward = counted.mean(axis=1)
    turn = (counted[:, 1] - counted[:, 0]) / (config.skid_ratio * gauge)
    yaw = start[2] + np.concatenate([[0.0], np.cumsum(turn)])
    middle = 0.5 * (yaw[1:] + yaw[:-1])
    steps = np.stack([forward * np.cos(middle), forward * np.sin(middle)], -1)
    position = start[:2] + np.vstack([np.zeros(2), np.cumsum(steps, axis=0)])
    return np.column_stack([position, yaw])
