"""Where the laser sits on the robot, as the drive itself tells: hand-eye calibration.

A log may put the laser at the robot's origin because nobody measured where it is. But odometry counts the
motion of the wheels' middle, and a matcher that of the laser: where the robot turns, the two differ by the
lever between them (Censi, Marchionni & Oriolo 2013, simultaneous calibration of odometry and sensor
parameters).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import chdtri

from slam import se2
from slam.odometry.track import Track, Verdict
from slam.recording import Recording
from slam.se2 import Array

ROUNDS = 20
"""Iterations of the reweighted least squares."""


@dataclass(frozen=True)
class LaserMountConfig:
    """When a mount is estimated, and when the estimate is believed."""

    estimate: bool = True
    """Whether the mount is estimated where nobody states it."""
    min_steps: int = 50
    """Matched steps that it takes."""
    min_motion: float = 0.02
    """A step tells something if the robot drove or turned by more [m or rad]."""
    cauchy: float = 2.0
    """Residuals of so many standard deviations count half."""
    max_sigma: float = 0.01
    """Largest standard deviation [m] that is believed: a drive that hardly turns knows no place."""
    min_distance: float = float(chdtri(3, 0.001))
    """Squared Mahalanobis distance from the robot's origin from which a mount differs from it, χ²₃(0.999)."""


@dataclass(frozen=True)
class Mount:
    """Pose ``(3,)`` of the laser in the robot's frame (m, m, rad), and standard deviations ``sigma (3,)``."""

    T_robot_laser: Array
    sigma: Array

    def __str__(self) -> str:
        (x, y), (sigma_x, sigma_y) = self.T_robot_laser[:2], self.sigma[:2]
        yaw, sigma_yaw = np.degrees([self.T_robot_laser[2], self.sigma[2]])
        place = f"x {x:.3f} ± {sigma_x:.3f} m, y {y:.3f} ± {sigma_y:.3f} m"
        return f"{place}, yaw {yaw:.2f} ± {sigma_yaw:.2f}°"


def is_mount_unstated(recording: Recording) -> bool:
    """Whether a recording of wheels and laser puts the laser at the robot's origin, and nobody knows better.

    With truth or with the robot's poses from elsewhere the origin has a meaning of its own.
    """
    laser = recording.laser
    at_origin = not laser.mount_stated and not np.any(laser.T_robot_laser)
    return at_origin and recording.source == "odometry" and recording.truth is None


def estimate_mount(
    recording: Recording, track: Track, config: LaserMountConfig = LaserMountConfig()
) -> Mount | None:
    """The mount that makes the matched steps of a track agree best with the odometry.

    ``track`` is what a front end makes of the recording with the laser at the origin, so that its poses are
    the laser's. None where the drive does not tell, or tells nothing that differs from the origin.
    """
    moved_laser, moved_robot = _steps(recording, track, config.min_motion)
    if len(moved_robot) < config.min_steps:
        return None
    solution, covariance = _solve(*_equations(moved_laser, moved_robot), config.cauchy)
    mount, covariance = solution[:3], covariance[:3, :3]
    sigma = np.sqrt(np.diag(covariance))
    distance = mount @ np.linalg.solve(covariance, mount)
    if sigma[:2].max() > config.max_sigma or distance < config.min_distance:
        return None
    return Mount(mount, sigma)


def _steps(recording: Recording, track: Track, min_motion: float) -> tuple[Array, Array]:
    """Relative poses ``(n, 3)`` over the matched steps: the laser's by matching, the robot's by odometry."""
    rows = np.flatnonzero((track.verdict == Verdict.MATCHED) & (track.reference >= 0))
    before = track.reference[rows]
    moved_laser = se2.between(track.poses[before], track.poses[rows])
    moved_robot = se2.between(recording.dead_reckoning[before], recording.dead_reckoning[rows])
    drove, turned = np.linalg.norm(moved_robot[:, :2], axis=1), np.abs(moved_robot[:, 2])
    moving = np.maximum(drove, turned) > min_motion
    return moved_laser[moving], moved_robot[moving]


def _equations(moved_laser: Array, moved_robot: Array) -> tuple[Array, Array]:
    """Rows ``(n, 2, 4)`` and right sides ``(n, 2)`` for mount (x, y, yaw) and the odometry's scale.

    ``R(m_yaw) t_laser = (1 + scale) t_robot + (R(turn) − 1) m``, with a small yaw and scale; the turn is the
    matched one, which is the better known.
    """
    cosine, sine = np.cos(moved_laser[:, 2]) - 1.0, np.sin(moved_laser[:, 2])
    x, y = moved_robot[:, 0], moved_robot[:, 1]
    rows = np.stack([np.stack([cosine, -sine, y, x], -1), np.stack([sine, cosine, -x, y], -1)], axis=1)
    return rows, moved_laser[:, :2] - moved_robot[:, :2]


def _solve(rows: Array, sides: Array, cauchy: float) -> tuple[Array, Array]:
    """Solution ``(4,)`` and covariance ``(4, 4)`` by least squares with a Cauchy weight per step."""
    weight = np.ones(len(rows))
    for _ in range(ROUNDS):
        normal = np.einsum("n,nij,nik->jk", weight, rows, rows)
        solution = np.linalg.solve(normal, np.einsum("n,nij,ni->j", weight, rows, sides))
        residual = sides - rows @ solution
        spread = 1.4826 * float(np.median(np.abs(residual)))
        weight = 1.0 / (1.0 + np.sum(residual**2, axis=1) / (cauchy * spread) ** 2)
    return solution, spread**2 * np.linalg.inv(normal)
