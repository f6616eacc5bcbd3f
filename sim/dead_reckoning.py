"""Dead reckoning: of an INS, whose yaw drifts with turning and jumps on a shock, and of tracks, whose
encoders count what they turn, not what the ground gives back."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from slam.se2 import Array

Model = Literal["usarsim", "consistent"]


@dataclass(frozen=True)
class InertialConfig:
    """How wrong the INS is, per step between two of its readings.

    Raises ``ValueError`` for another model or a precision that is not positive.
    """

    model: Model = "usarsim"
    """"usarsim" adds true position increments (INS.uc of USARSim: position ignores the yaw error; §6.2.4 of
    Formsma's thesis), "consistent" turns them by the yaw error."""
    yaw_noise: float = 0.06
    """Standard deviation of the relative error of each yaw increment."""
    position_noise: float = 0.06
    """Standard deviation of the relative error of each position increment."""
    precision: float | None = None
    """P draws a constant relative error once per run, uniform of width 1/P² (yaw) and 1/P (position)."""
    bias_walk: float = 0.0
    """Random walk of a gyro bias [rad/s per √s]."""
    attitude_noise: float = np.deg2rad(0.6)
    """Standard deviation of roll and pitch [rad]."""

    def __post_init__(self) -> None:
        if self.model not in get_args(Model):
            raise ValueError(f"INS model: expected one of {get_args(Model)}, got {self.model!r}")
        if self.precision is not None and not self.precision > 0.0:
            raise ValueError(f"INS precision: expected > 0, got {self.precision}")


@dataclass(frozen=True)
class ShockConfig:
    """A blow or a landing upsets the INS: its yaw and roll jump, either way."""

    impulse: float = 14.0
    """Least impulse [N s] that does."""
    jump: float = np.deg2rad(12.0)
    """About how far they jump [rad]: four to six fifths of it."""
    rest: float = 5.0
    """Least time [s] between two jumps."""


def ins_poses(
    truth: ArrayLike, time: ArrayLike, yaw_jumps: ArrayLike, config: InertialConfig, rng: np.random.Generator
) -> Array:
    """INS poses ``(M, 3)`` along true poses ``truth (M, 3)``, yaw not wrapped, at ``time (M,)`` s.

    ``yaw_jumps (M,)`` rad are added at the reading where a shock happened. The first reading is true.
    """
    truth, time = np.asarray(truth, dtype=np.float64), np.asarray(time, dtype=np.float64)
    yaw_jumps = np.asarray(yaw_jumps, dtype=np.float64)
    constant, scaling, wandering, biasing = rng.spawn(4)
    step, turn, dt = np.diff(truth[:, :2], axis=0), np.diff(truth[:, 2]), np.diff(time)
    mean = np.zeros(3)
    if config.precision is not None:
        width = np.array([1.0 / config.precision, 1.0 / config.precision, 1.0 / config.precision**2])
        mean = (constant.random(3) - 0.5) * width
    scale = mean[2] + config.yaw_noise * scaling.standard_normal(len(turn))
    bias = np.cumsum(config.bias_walk * np.sqrt(dt) * biasing.standard_normal(len(dt)))
    error = np.concatenate([[0.0], np.cumsum(turn * scale + bias * dt + yaw_jumps[1:])])
    wander = np.hypot(step[:, 0], step[:, 1])[:, None] * (
        mean[:2] + config.position_noise * wandering.standard_normal((len(turn), 2))
    )
    if config.model == "consistent":
        middle = 0.5 * (error[1:] + error[:-1])
        c, s = np.cos(middle), np.sin(middle)
        step = np.stack([c * step[:, 0] - s * step[:, 1], s * step[:, 0] + c * step[:, 1]], -1)
    moved = step + wander
    position = truth[0, :2] + np.vstack([np.zeros(2), np.cumsum(moved, axis=0)])
    return np.column_stack([position, truth[:, 2] + error])


def shocks(time: ArrayLike, impulse: ArrayLike, config: ShockConfig, rng: np.random.Generator) -> Array:
    """Jumps ``(M, 2)`` rad of yaw and roll at each reading, zero where nothing happened.

    ``impulse (M,)`` N s is the largest since the reading before.
    """
    time, impulse = np.asarray(time, dtype=np.float64), np.asarray(impulse, dtype=np.float64)
    jumps = np.zeros((len(time), 2))
    last = -np.inf
    for k in np.flatnonzero(impulse >= config.impulse):
        if time[k] - last >= config.rest:
            jumps[k] = config.jump * rng.uniform(0.8, 1.2, 2) * rng.choice([-1.0, 1.0], 2)
            last = time[k]
    return jumps


def attitude(
    tilt: ArrayLike, roll_jumps: ArrayLike, config: InertialConfig, rng: np.random.Generator
) -> Array:
    """Roll and pitch ``(M, 2)`` rad as the INS says: true ``tilt (M, 2)``, noise, and ``roll_jumps (M,)``."""
    tilt = np.asarray(tilt, dtype=np.float64)
    reported = tilt + config.attitude_noise * rng.standard_normal(tilt.shape)
    reported[:, 0] += np.cumsum(roll_jumps)
    return reported


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


def wheel_odometry(
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
