"""The inertial navigation system: dead reckoning whose yaw drifts with turning and jumps on a shock."""

from __future__ import annotations

from dataclasses import dataclass
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


def dead_reckon(
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
    moved = step + wander
    if config.model == "consistent":
        middle = 0.5 * (error[1:] + error[:-1])
        c, s = np.cos(middle), np.sin(middle)
        moved = np.stack([c * step[:, 0] - s * step[:, 1], s * step[:, 0] + c * step[:, 1]], -1) + wander
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
