"""OpenKarto's scan matcher (package karto-scanmatcher) as odometry: each scan against the last ones, from
where dead reckoning puts it; no loops are closed."""

from __future__ import annotations

from collections import deque
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from slam import se2
from slam.recording import Recording
from slam.se2 import Array

RUNNING_SCANS, TUNED_SCANS = 10, 20
"""Scans that are matched against: as slam_toolbox buffers, and tuned."""
TUNED_PENALTY = 0.1
"""How little the matcher holds to dead reckoning, in distance [m²] and angle [rad²]."""
TRAVEL, TUNED_TRAVEL, TURN = 0.2, 0.3, np.radians(10.0)
"""A scan is matched after so much driving [m] or turning [rad]; others follow dead reckoning."""


def solve(recording: Recording, settings: str, folder: Path) -> Array:
    """Poses ``(N, 3)`` of the robot."""
    karto = import_module("karto_scanmatcher")
    tuned, config = settings == "tuned", karto.ScanMatcherConfig()
    if tuned:
        config.distance_variance_penalty = config.angle_variance_penalty = TUNED_PENALTY
    config.range_threshold = min(config.range_threshold, recording.laser.range_max)
    matcher = karto.Wrapper(config)
    laser = _laser(karto, recording, config.range_threshold)
    mount = recording.laser.T_robot_laser
    reckoned = se2.compose(recording.dead_reckoning, mount)
    running: deque[Any] = deque(maxlen=TUNED_SCANS if tuned else RUNNING_SCANS)
    travel = TUNED_TRAVEL if tuned else TRAVEL
    poses, kept = [reckoned[0]], 0
    for k in range(len(recording)):
        pose = se2.compose(poses[kept], se2.between(reckoned[kept], reckoned[k]))
        moved = se2.between(reckoned[kept], reckoned[k])
        if k == 0 or np.hypot(*moved[:2]) >= travel or abs(moved[2]) >= TURN:
            ranges = np.where(np.isfinite(recording.ranges[k]), recording.ranges[k], 0.0).tolist()
            start = karto.Pose2(*pose)
            scan = karto.LocalizedRangeScan(laser, ranges, start, start, k, float(k))
            if running:
                found = matcher.match_scan(scan, list(running), True, True).best_pose
                pose = np.array([found.x, found.y, found.yaw])
                scan.corrected_pose = found
            running.append(scan)
            kept = k
        poses[k:] = [pose]
    return se2.compose(np.array(poses), se2.inverse(mount))


def _laser(karto: Any, recording: Recording, threshold: float) -> Any:
    """The laser as Karto describes it."""
    angles, laser = recording.angles, recording.laser
    step = float(np.diff(angles).mean())
    return karto.LaserScanConfig(
        float(angles[0]), float(angles[-1]), step, laser.range_min, laser.range_max, threshold, "laser"
    )
