"""What the matcher teaches about an inertial sensor while the robot drives (report §6.2.4).

Its yaw has a scale and a bias. And it counts its position in a world of its own: once the map's yaw is off,
the map lies turned in that world.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from slam import se2
from slam.se2 import Array

SCALE_SIGMA, BIAS_SIGMA, HEADING_SIGMA = 0.05, 0.002, 0.02
"""What is known at the start: yaw scale, yaw bias [rad/s], heading of the map in the sensor's world [rad]."""
YAW_SIGMA = 0.006
"""Noise [rad] of a step's yaw increment; a step off by more than three of it is a shock, and teaches
nothing."""
POSITION_SIGMA = 0.01
"""Noise [m] of a step's position increment."""
MEMORY = 0.995
"""What is left of a lesson one step later: sensors drift."""
MOST_TURN = 0.3
"""Most [rad] that one step may tell about the heading."""


def _known() -> Array:
    return np.diag([SCALE_SIGMA**-2, BIAS_SIGMA**-2])


@dataclass
class Calibration:
    """Yaw scale and bias by recursive least squares over matched steps, and the heading of the map in the
    sensor's world.

    ``coefficients (2,)`` are the scale and the bias [rad/s], ``information (2, 2)`` how well they are known;
    ``heading`` rad turns increments of the sensor's world into the map.
    """

    coefficients: Array = field(default_factory=lambda: np.array([1.0, 0.0]))
    information: Array = field(default_factory=_known)
    heading: float = 0.0
    heading_information: float = HEADING_SIGMA**-2

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
        regressor = np.array([sensed, seconds])
        innovation = float(se2.wrap(matched - self.coefficients @ regressor))
        if abs(innovation) > 3.0 * YAW_SIGMA:
            return
        weight = 1.0 / (YAW_SIGMA**2 + sigma**2)
        remembered = _known() + MEMORY * (self.information - _known())
        self.information = remembered + weight * np.outer(regressor, regressor)
        self.coefficients += np.linalg.solve(self.information, weight * innovation * regressor)

    def _learn_heading(self, sensed: Array, matched: Array, sigma: Array) -> None:
        """One more weighted mean of the difference between the course matched and the course sensed."""
        way = float(np.hypot(sensed[0], sensed[1]))
        if way < 5.0 * POSITION_SIGMA:
            return
        course = np.arctan2(matched[1], matched[0]) - np.arctan2(sensed[1], sensed[0])
        innovation = np.clip(float(se2.wrap(course - self.heading)), -MOST_TURN, MOST_TURN)
        weight = way**2 / (POSITION_SIGMA**2 + float(sigma @ sigma))
        self.heading_information = MEMORY * self.heading_information + weight
        self.heading += float(innovation * weight / self.heading_information)
