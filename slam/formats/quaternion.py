"""Quaternions (w, x, y, z) of any length but zero, for R = Rz(yaw) Ry(pitch) Rx(roll)."""

from __future__ import annotations

import math


def roll_pitch(w: float, x: float, y: float, z: float) -> tuple[float, float]:
    """Roll and pitch [rad]."""
    to_left, upwards = 2.0 * (w * x + y * z), w * w - x * x - y * y + z * z
    return math.atan2(to_left, upwards), math.atan2(2.0 * (w * y - x * z), math.hypot(to_left, upwards))


def yaw_of(w: float, x: float, y: float, z: float) -> float:
    """Yaw [rad]."""
    return math.atan2(2.0 * (w * z + x * y), w * w + x * x - y * y - z * z)


def from_angles(roll: float, pitch: float, yaw: float) -> tuple[float, float, float, float]:
    """The unit quaternion of roll, pitch and yaw [rad]."""
    cr, cp, cy = math.cos(0.5 * roll), math.cos(0.5 * pitch), math.cos(0.5 * yaw)
    sr, sp, sy = math.sin(0.5 * roll), math.sin(0.5 * pitch), math.sin(0.5 * yaw)
    return (
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
    )


def matrix(w: float, x: float, y: float, z: float) -> tuple[tuple[float, float, float], ...]:
    """Rows of the rotation matrix."""
    s = 2.0 / (w * w + x * x + y * y + z * z)
    return (
        (1.0 - s * (y * y + z * z), s * (x * y - w * z), s * (x * z + w * y)),
        (s * (x * y + w * z), 1.0 - s * (x * x + z * z), s * (y * z - w * x)),
        (s * (x * z - w * y), s * (y * z + w * x), 1.0 - s * (x * x + y * y)),
    )
