"""What dead reckoning says of a step, and how far it may be believed.

An INS increments its position in its own world frame, whatever its yaw does (USARSim's INS, Formsma §6.2.4);
wheel odometry increments in the body frame. The variances were measured on recordings of both kinds. Where
there is no dead reckoning, a robot is expected where it was, the less surely the longer ago that is.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from slam import se2
from slam.measurements import Measurements
from slam.odometry.calibration import Calibration
from slam.se2 import Array


@dataclass(frozen=True)
class DeadReckoningConfig:
    """Noise of dead reckoning."""

    ins_walk: float = 5e-4
    """Variance of an INS's position per metre travelled [m²/m]."""
    ins_position_sigma: float = 0.003
    """Standard deviation [m] of each of the two readings that an INS's increment at rest is made of."""
    ins_yaw_sigma: float = 0.006
    """Standard deviation [rad] of an INS's yaw increment at rest."""
    ins_turn_share: float = 0.03
    """Share of a turn by which an INS's yaw increment is off (one sigma)."""
    odometry_sigma: float = 0.01
    """Standard deviation [m] of a wheel odometry's increment at rest."""
    odometry_path_share: float = 0.06
    """Share of the way by which a wheel odometry is off (one sigma)."""
    odometry_side_share: float = 0.10
    """Sideways error [m] of a wheel odometry per metre and radian turned (one sigma)."""
    odometry_yaw_sigma: float = 0.01
    """Standard deviation [rad] of a wheel odometry's yaw increment at rest."""
    odometry_turn_share: float = 0.10
    """Share of a turn by which a wheel odometry's yaw increment is off (one sigma)."""
    odometry_yaw_per_metre: float = 0.04
    """Yaw error [rad] of a wheel odometry per metre driven (one sigma)."""
    doubt: tuple[float, float] = (0.5, np.radians(20.0))
    """Standard deviations (m, rad) that a contradicted step has on top."""
    speed_sigma: float = 0.5
    """Speed [m/s] that a robot without dead reckoning may have had since it was last seen (one sigma)."""
    turn_sigma: float = 0.5
    """Turning speed [rad/s], likewise."""
    least_seconds: float = 0.1
    """Least time [s] between two scans, whatever their stamps say: some logs' go backwards."""


class DeadReckoning:
    """Dead reckoning of the scans in ``measurements``, with the noise of ``config``.

    The map frame is the dead reckoning's: every method starts at the first recorded pose. ``contradicted
    (N,)`` bool marks the scans whose step is not to be believed, by default none.
    """

    def __init__(
        self,
        measurements: Measurements,
        config: DeadReckoningConfig = DeadReckoningConfig(),
        contradicted: np.ndarray | None = None,
    ) -> None:
        self.measurements, self.config = measurements, config
        self.contradicted = contradicted

    @property
    def in_world(self) -> bool:
        """Whether increments live in the sensor's own world frame: an INS's do."""
        return self.measurements.source == "ins"

    @property
    def absent(self) -> bool:
        """Whether the laser is alone."""
        return self.measurements.source == "none"

    @property
    def poses(self) -> Array:
        """Recorded poses ``(n, 3)``."""
        return self.measurements.dead_reckoning

    def seconds(self, j: int, k: int) -> float:
        """Time [s] from scan j to scan k."""
        return float(self.measurements.time[k] - self.measurements.time[j])

    def predict(self, j: int, k: int, pose_j: Array, calibration: Calibration | None = None) -> Array:
        """Pose ``(3,)`` at scan k in the map frame, from the pose at scan j and the recorded increment, which
        an INS's ``calibration`` corrects. Without dead reckoning the robot stands still."""
        before, after = self.poses[j], self.poses[k]
        if not self.in_world:
            return se2.compose(pose_j, se2.between(before, after))
        step = after - before
        if calibration is not None:
            step = calibration.corrected(step, self.seconds(j, k))
        predicted = pose_j + step
        return np.array([predicted[0], predicted[1], float(se2.wrap(predicted[2]))])

    def step_covariance(self, j: int | np.ndarray, k: int | np.ndarray) -> Array:
        """Covariance ``(..., 3, 3)`` of the recorded increments from scans j ``(...)`` to k.

        For an INS of additive world-frame errors (x, y, yaw); for odometry in the body frame of scan k.
        Without dead reckoning it is as wide as a robot can have come in that time.
        """
        c = self.config
        if self.absent:
            time = self.measurements.time
            seconds = np.maximum(np.abs(time[k] - time[j]), c.least_seconds)
            speeds = np.diag([c.speed_sigma, c.speed_sigma, c.turn_sigma]) ** 2
            return speeds * np.asarray(seconds)[..., None, None] ** 2
        noise = self._step_noise(j, k)
        return noise if self.contradicted is None else noise + self._doubt(self.contradicted, j, k)

    def _step_noise(self, j: int | np.ndarray, k: int | np.ndarray) -> Array:
        c, step = self.config, se2.between(self.poses[j], self.poses[k])
        path, turn = np.hypot(step[..., 0], step[..., 1]), np.abs(step[..., 2])
        if self.in_world:
            position = self.position_variance(path)
            return _diagonal(position, position, c.ins_yaw_sigma**2 + (c.ins_turn_share * turn) ** 2)
        along = c.odometry_sigma**2 + (c.odometry_path_share * path) ** 2
        side = along + (c.odometry_side_share * turn * path) ** 2
        turned = c.odometry_yaw_sigma**2 + (c.odometry_turn_share * turn) ** 2
        return _diagonal(along, side, turned + (c.odometry_yaw_per_metre * path) ** 2)

    def _doubt(self, contradicted: np.ndarray, j: int | np.ndarray, k: int | np.ndarray) -> Array:
        """What contradicted steps among j+1..k add, ``(..., 3, 3)``."""
        if np.ndim(k) == 0:
            count = np.asarray(np.count_nonzero(contradicted[j + 1 : k + 1]))
        else:
            before = np.concatenate([[0], np.cumsum(contradicted)])
            count = before[k + 1] - before[j + 1]
        shift, turn = self.config.doubt
        return count[..., None, None] * np.diag([shift, shift, turn]) ** 2

    def position_variance(self, path: Array) -> Array:
        """Variance [m²] of an INS's position increments over ways ``path (...)`` m, per axis."""
        return self.config.ins_walk * path + 2.0 * self.config.ins_position_sigma**2

    def map_covariance(self, j: int, k: int, pose_k: Array) -> Array:
        """Covariance ``(3, 3)`` of additive map-frame errors of the pose predicted at scan k."""
        covariance = self.step_covariance(j, k)
        if self.in_world:
            return covariance
        turned = np.eye(3)
        turned[:2, :2] = se2.rotation(pose_k[2])
        return turned @ covariance @ turned.T

    def body_covariance(self, j: int, k: int, pose_k: Array) -> Array:
        """Covariance ``(3, 3)`` of the predicted step in the body frame of scan k."""
        return se2.to_body_covariance(pose_k, self.map_covariance(j, k, pose_k))

    def lost_covariance(self, last_matched: int, last: int, k: int, pose_k: Array) -> Array:
        """What scan k adds in its body frame to the covariance at scan ``last`` of a robot that was last
        matched at scan ``last_matched``.

        The errors of dead reckoning's steps are independent; without dead reckoning they are one: a speed.
        """
        step = self.body_covariance(last, k, pose_k)
        if not self.absent or last == last_matched:
            return step
        return np.maximum(
            self.step_covariance(last_matched, k) - self.step_covariance(last_matched, last), step
        )


def _diagonal(*variances: Array) -> Array:
    return np.stack(variances, -1)[..., None] * np.eye(3)
