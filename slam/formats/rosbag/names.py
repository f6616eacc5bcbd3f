"""Names in a bag: message types, and the topics and frames of our own bags."""

from __future__ import annotations

SCAN_TYPE, ODOMETRY_TYPE = "sensor_msgs/msg/LaserScan", "nav_msgs/msg/Odometry"
TF_TYPE, OLD_TF_TYPE, IMU_TYPE = "tf2_msgs/msg/TFMessage", "tf/msg/tfMessage", "sensor_msgs/msg/Imu"
SCAN, INS, ODOMETRY, TRUTH, ATTITUDE = "/scan", "/ins", "/odom", "/ground_truth", "/imu"
TF, TF_STATIC = "/tf", "/tf_static"
WORLD, START, BASE, LASER = "map", "odom", "base_link", "laser"
"""Frames: of the truth, of the dead reckoning, of the robot, of the laser."""
RANGE_DECIMALS, ANGLE_DECIMALS = 5, 6
"""Messages hold 32-bit floats; so many of their decimals mean something."""


def seconds(stamp: object) -> float:
    """A message's stamp in seconds."""
    return stamp.sec + 1e-9 * stamp.nanosec  # type: ignore[attr-defined]


def frame(name: str) -> str:
    """A frame's name as tf2 has it."""
    return name.removeprefix("/")
