"""KISS-ICP (Vizzo et al. 2023) as odometry: scans as clouds of one height, the laser alone."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path

import numpy as np

from slam import se2
from slam.recording import Recording
from slam.se2 import Array

TUNED_VOXEL, TUNED_THRESHOLD, TUNED_MOTION = 0.1, 0.5, 0.01
"""Side of a voxel, first threshold of a correspondence, and motion that counts [m]."""


def solve(recording: Recording, settings: str, folder: Path) -> Array:
    """Poses ``(N, 3)`` of the robot."""
    config = import_module("kiss_icp.config").load_config(None)
    config.data.deskew = False  # a scan has one stamp
    config.data.max_range = recording.laser.range_max
    config.data.min_range = recording.laser.range_min
    config.mapping.voxel_size = config.data.max_range / 100.0  # as its own pipeline sets it
    if settings == "tuned":
        config.mapping.voxel_size = TUNED_VOXEL
        config.adaptive_threshold.initial_threshold = TUNED_THRESHOLD
        config.adaptive_threshold.min_motion_th = TUNED_MOTION
    odometry, poses = import_module("kiss_icp.kiss_icp").KissICP(config), []
    directions = np.stack([np.cos(recording.angles), np.sin(recording.angles)], -1)
    for ranges in recording.ranges:
        seen = np.isfinite(ranges)
        flat = ranges[seen, None] * directions[seen]
        cloud = np.column_stack([flat, np.zeros(len(flat))])
        if len(cloud):  # blind scans leave it where it is
            odometry.register_frame(cloud, np.zeros(len(cloud)))
        T = odometry.last_pose
        poses.append([T[0, 3], T[1, 3], np.arctan2(T[1, 0], T[0, 0])])
    mount = recording.laser.T_robot_laser
    return se2.compose(se2.compose(mount, np.array(poses)), se2.inverse(mount))
