"""What dead reckoning says of a step, and how far it may be believed.

An INS increments its position in its own world frame, whatever its yaw does (USARSim's INS, report
§6.2.4); wheel odometry increments in the body frame. The variances were measured on recordings of both
kinds. Where there is no dead reckoning, a robot is expected where it was, the less surely the longer ago
that is.
"""

from __future__ import annotations

import numpy as np

from slam import se2
from slam.odometry.calibration import Calibration
from slam.recording import Recording
from slam.se2 import Array

INS_WALK = 5e-4
"""Variance of an INS's position per metre travelled [m²/m]."""

INS_POSITION_FLOOR = 2.0 * 0.003**2
"""Variance of an INS position increment at rest [m²]."""

SPEED_SIGMA, TURN_SIGMA = 0.5, 0.5
"""Speed [m/s, rad/s] that a robot without dead reckoning may have had since it was last seen (one sigma)."""

SHORTEST = 0.1
"""Least time [s] that passes between two scans, whatever their stamps say: some logs' go backwards."""


def predict(
    recording: Recording, j: int, k: int, pose_j: Array, calibration: Calibration | None = None
) -> Array:
    """Pose ``(3,)`` at scan k in the map frame, from the pose at scan j and the recorded increment, which an
    INS's ``calibration`` corrects.

    The map frame is the dead reckoning's: every method starts at the first recorded pose. Without dead
    reckoning the robot stands still.
    """
    before, after = recording.dead_reckoning[j], recording.dead_reckoning[k]
    if recording.source != "ins":
        return se2.compose(pose_j, se2.between(before, after))
    step = after - before
    if calibration is not None:
        step = calibration.corrected(step, float(recording.time[k] - recording.time[j]))
    predicted = pose_j + step
    return np.array([predicted[0], predicted[1], float(se2.wrap(predicted[2]))])


def step_covariance(recording: Recording, j: int | np.ndarray, k: int | np.ndarray) -> Array:
    """Covariance ``(..., 3, 3)`` of the recorded increments from scans j ``(...)`` to k.

    For an INS of additive world-frame errors (x, y, yaw); for odometry in the body frame of scan k. Without
    dead reckoning it is as wide as a robot can have come in that time.
    """
    if recording.source == "none":
        seconds = np.maximum(np.abs(recording.time[k] - recording.time[j]), SHORTEST)
        speeds = np.diag([SPEED_SIGMA, SPEED_SIGMA, TURN_SIGMA]) ** 2
        return speeds * np.asarray(seconds)[..., None, None] ** 2
    step = se2.between(recording.dead_reckoning[j], recording.dead_reckoning[k])
    path, turn = np.hypot(step[..., 0], step[..., 1]), np.abs(step[..., 2])
    if recording.source == "ins":
        position = INS_WALK * path + INS_POSITION_FLOOR
        return _diagonal(position, position, 0.006**2 + (0.03 * turn) ** 2)
    along = 0.01**2 + (0.06 * path) ** 2
    side = along + (0.10 * turn * path) ** 2
    return _diagonal(along, side, 0.01**2 + (0.10 * turn) ** 2 + (0.04 * path) ** 2)


def _diagonal(*variances: Array) -> Array:
    return np.stack(variances, -1)[..., None] * np.eye(3)


def map_covariance(recording: Recording, j: int, k: int, pose_k: Array) -> Array:
    """Covariance ``(3, 3)`` of additive map-frame errors of the pose predicted at scan k."""
    covariance = step_covariance(recording, j, k)
    if recording.source == "ins":
        return covariance
    turned = np.eye(3)
    turned[:2, :2] = se2.rotation(pose_k[2])
    return turned @ covariance @ turned.T


def lost_covariance(recording: Recording, sure: int, last: int, k: int, pose_k: Array) -> Array:
    """What scan k adds in its body frame to the covariance at scan ``last`` of a robot that was last matched
    at scan ``sure``.

    The errors of dead reckoning's steps are independent; without dead reckoning they are one: a speed.
    """
    step = body_covariance(recording, last, k, pose_k)
    if recording.source != "none" or last == sure:
        return step
    return np.maximum(step_covariance(recording, sure, k) - step_covariance(recording, sure, last), step)


def body_covariance(recording: Recording, j: int, k: int, pose_k: Array) -> Array:
    """Covariance ``(3, 3)`` of the predicted step in the body frame of scan k."""
    return se2.to_body_covariance(pose_k, map_covariance(recording, j, k, pose_k))
