"""The driver: pure pursuit along a route, slower on rough ground, and a way out when the robot is stuck."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from slam import se2
from slam.se2 import Array

Ending = Literal["completed", "stuck", "flipped over", "out of time"]


@dataclass(frozen=True)
class DriverConfig:
    """Habits of the driver, who stops to look around now and then, and backs off and turns when stuck."""

    speed: float = 0.75
    """On level ground [m/s]."""
    turn_rate: float = 0.6
    """Largest [rad/s]."""
    lookahead: float = 0.45
    """Distance [m] along the route to the point that is aimed at."""
    turn_in_place: float = np.deg2rad(50.0)
    """Bearing [rad] of that point from which the robot turns on the spot."""
    caution: float = 10.0
    """Speed is divided by 1 + caution · tilt or roughness [1/rad]."""
    pause_every: float = 11.0
    """Mean time [s] between two stops."""
    pause_mean: float = 4.0
    """Mean time [s] of a stop."""
    stuck_time: float = 3.0
    """A robot is stuck that in this time [s] ..."""
    stuck_distance: float = 0.1
    """... has come no further than this [m]."""
    back_time: float = 1.2
    """Time [s] of backing off."""
    turn_time: float = 1.0
    """Time [s] of turning after that."""
    attempts: int = 6
    """Times of backing off before the driver gives up."""
    time_limit: float = 900.0
    """Longest drive [s]."""
    flipped: float = np.deg2rad(60.0)
    """Roll or pitch [rad] beyond which the robot has fallen over."""


def resample(waypoints: ArrayLike, spacing: float = 0.05) -> Array:
    """Points ``(P, 2)`` m every ``spacing`` along the polyline through ``waypoints (K, 2)``.

    Raises ``ValueError`` for fewer than two waypoints.
    """
    waypoints = np.asarray(waypoints, dtype=np.float64)
    if waypoints.ndim != 2 or waypoints.shape[0] < 2 or waypoints.shape[1] != 2:
        raise ValueError(f"a route needs waypoints (K >= 2, 2), got {waypoints.shape}")
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(waypoints, axis=0).T))])
    at = np.linspace(0.0, along[-1], max(2, int(np.ceil(along[-1] / spacing)) + 1))
    return np.column_stack([np.interp(at, along, waypoints[:, k]) for k in (0, 1)])


class Driver:
    """Follows a route; remembers how far it has come and what it is doing about being stuck."""

    def __init__(self, waypoints: ArrayLike, config: DriverConfig, rng: np.random.Generator) -> None:
        self.config = config
        self._path = resample(waypoints)
        self._spacing = float(np.hypot(*(self._path[1] - self._path[0])))
        self._rng = rng
        self._progress = 0
        self._best = 0
        self._attempts = 0
        self._anchor = (0.0, np.inf, np.inf, 0.0)  # time, x, y, yaw when it last counted as having moved
        self._escape: tuple[float, float, float] | None = None  # end of backing, end of turning, side
        self._pause_until = 0.0
        self._next_pause = config.pause_every * rng.exponential()

    def command(
        self, time: float, pose: tuple[float, float, float], tilt: tuple[float, float], roughness: float
    ) -> tuple[float, float] | Ending:
        """Speed [m/s] and turn rate [rad/s] wanted now, or why the drive is over.

        ``tilt`` is (roll, pitch) rad, ``roughness`` rad what the ground adds to it.
        """
        self._advance(pose)
        ending = self._ending(time, tilt)
        if ending is not None:
            return ending
        if self._escape is not None:
            return self._back_off(time, pose)
        if time < self._pause_until:
            self._anchor = (time, *pose)
            return 0.0, 0.0
        if time >= self._next_pause:
            self._pause_until = time + self.config.pause_mean * self._rng.exponential()
            self._next_pause = self._pause_until + self.config.pause_every * self._rng.exponential()
        if self._is_stuck(time, pose):
            return self._back_off(time, pose)
        return self._pursue(pose, max(roughness, np.hypot(*tilt)))

    def _advance(self, pose: tuple[float, float, float], window: float = 0.6) -> None:
        """Move on to the nearest point of the next stretch of the route."""
        ahead = self._path[self._progress : self._progress + max(2, int(window / self._spacing))]
        self._progress += int(np.argmin(np.hypot(ahead[:, 0] - pose[0], ahead[:, 1] - pose[1])))
        if self._progress > self._best + int(1.0 / self._spacing):
            self._best, self._attempts = self._progress, 0

    def _ending(self, time: float, tilt: tuple[float, float]) -> Ending | None:
        if max(abs(tilt[0]), abs(tilt[1])) > self.config.flipped:
            return "flipped over"
        if self._progress >= len(self._path) - 2:
            return "completed"
        if self._attempts > self.config.attempts:
            return "stuck"
        return "out of time" if time > self.config.time_limit else None

    def _is_stuck(self, time: float, pose: tuple[float, float, float]) -> bool:
        since, x, y, yaw = self._anchor
        turned = abs(float(se2.wrap(pose[2] - yaw)))
        if np.hypot(pose[0] - x, pose[1] - y) > self.config.stuck_distance or turned > 0.2:
            self._anchor = (time, *pose)
            return False
        if time - since < self.config.stuck_time:
            return False
        self._attempts += 1
        back_until = time + self.config.back_time
        side = 1.0 if self._rng.random() < 0.5 else -1.0
        self._escape = (back_until, back_until + self.config.turn_time, side)
        return True

    def _back_off(self, time: float, pose: tuple[float, float, float]) -> tuple[float, float]:
        assert self._escape is not None
        back_until, turn_until, side = self._escape
        if time >= turn_until:
            self._escape = None
            self._anchor = (time, *pose)
            return 0.0, 0.0
        if time < back_until:
            return -0.4 * self.config.speed, 0.0
        return 0.0, side * self.config.turn_rate

    def _pursue(self, pose: tuple[float, float, float], rough: float) -> tuple[float, float]:
        """Pure pursuit (Coulter 1992): the arc through a point of the route one look-ahead further."""
        c = self.config
        ahead = min(self._progress + max(1, int(c.lookahead / self._spacing)), len(self._path) - 1)
        dx, dy = self._path[ahead, 0] - pose[0], self._path[ahead, 1] - pose[1]
        bearing = float(se2.wrap(np.arctan2(dy, dx) - pose[2]))
        if abs(bearing) > c.turn_in_place:
            return 0.0, float(np.copysign(c.turn_rate, bearing))
        curvature = 2.0 * np.sin(bearing) / max(np.hypot(dx, dy), 0.5 * c.lookahead)
        speed = c.speed / (1.0 + c.caution * rough)
        speed = min(speed, c.turn_rate / max(abs(curvature), 1e-9))
        return speed, speed * curvature
