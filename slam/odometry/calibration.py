"""What the matcher teaches about an inertial sensor while the robot drives (Formsma §6.2.4).

Its yaw has a scale and a bias. And it counts its position in a world of its own: once the map's yaw is off,
the map lies turned in that world.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from slam import se2
from slam.se2 import Array


@dataclass(frozen=True)
class CalibrationConfig:
    """Priors and noise of the recursive least squares."""

    scale_sigma: float = 0.05
    """What is known of the yaw scale at the start (one sigma)."""
    bias_sigma: float = 0.002
    """What is known of the yaw bias at the start [rad/s] (one sigma)."""
    heading_sigma: float = 0.02
    """What is known at the start of the map's heading in the sensor's world [rad] (one sigma)."""
    yaw_sigma: float = 0.006
    """Noise [rad] of a step's yaw increment; a step off by more than three of it is a shock, and is left
    out."""
    position_sigma: float = 0.01
    """Noise [m] of a step's position increment."""
    forgetting: float = 0.995
    """Forgetting factor per step of the recursive least squares: sensors drift."""
    max_innovation: float = 0.3
    """Most [rad] that one step may tell about the heading."""


class Calibration:
    """Yaw scale and bias by recursive least squares over matched steps, and the heading of the map in the
    sensor's world.

    ``coefficients (2,)`` are the scale and the bias [rad/s], ``information (2, 2)`` how well they are known;
    ``heading`` rad turns increments of the sensor's world into the map.
    """

    def __init__(self, config: CalibrationConfig = CalibrationConfig()) -> None:
        self.config = config
        self.prior = np.diag([config.scale_sigma**-2, config.bias_sigma**-2])
        self.coefficients: Array = np.array([1.0, 0.0])
        self.information: Array = self.prior
        self.heading, self.heading_information = 0.0, config.heading_sigma**-2

    def corrected(self, sensed: Array, seconds: float) -> Array:
        """Increment ``(3,)`` to expect in the map where the sensor counted ``sensed (3,)`` (x, y, yaw)."""
        turn = self.coefficients @ [float(se2.wrap(sensed[2])), seconds]
        return np.append(se2.rotation(self.heading) @ sensed[:2], turn)

    def learn(self, sensed: Array, seconds: float, matched: Array, matched_sigma: Array) -> None:
        """Take in a step that the sensor counted as ``sensed (3,)`` and the matcher as ``matched (3,)`` in
        the map, with standard deviations ``matched_sigma (3,)``."""
        self._learn_yaw(float(se2.wrap(sensed[2])), seconds, float(matched[2]), float(matched_sigma[2]))
        self._learn_heading(sensed[:2], matched[:2], matched_sigma[:2])

    def _learn_yaw(self, sensed: float, seconds: float, matched: float, sigma: float) -> None:
        config, regressor = self.config, np.array([sensed, seconds])
        innovation = float(se2.wrap(matched - self.coefficients @ regressor))
        if abs(innovation) > 3.0 * config.yaw_sigma:
            return
        weight = 1.0 / (config.yaw_sigma**2 + sigma**2)
        remembered = self.prior + config.forgetting * (self.information - self.prior)
        self.information = remembered + weight * np.outer(regressor, regressor)
        self.coefficients += np.linalg.solve(self.information, weight * innovation * regressor)

    def _learn_heading(self, sensed: Array, matched: Array, sigma: Array) -> None:
        """One more weighted mean of the difference between the course matched and the course sensed."""
        config, way = self.config, float(np.hypot(sensed[0], sensed[1]))
        if way < 5.0 * config.position_sigma:
            return
        course = np.arctan2(matched[1], matched[0]) - np.arctan2(sensed[1], sensed[0])
        limit = config.max_innovation
        innovation = np.clip(float(se2.wrap(course - self.heading)), -limit, limit)
        weight = way**2 / (config.position_sigma**2 + float(sigma @ sigma))
        self.heading_information = config.forgetting * self.heading_information + weight
        self.heading += float(innovation * weight / self.heading_information)
