"""MRPT's icp-slam (Debian's mrpt-apps), by way of a CARMEN log and its carmen2rawlog."""

from __future__ import annotations

import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np

from slam.formats import carmen
from slam.recording import Recording
from slam.se2 import Array

STAMP_SCALE = 1e12
"""carmen2rawlog of MRPT 2.5.8 reads stamps so many times too small; without time icp-slam does nothing."""
INTERVAL = 0.25
"""Seconds between scans that it is told: stamps of logs may go backwards."""
ICP = {
    "maxIterations": "80",
    "thresholdDist": "0.3",
    "thresholdAng_DEG": "5",
    "ALFA": "0.8",
    "smallestThresholdDist": "0.05",
    "onlyClosestCorrespondences": "true",
    "onlyUniqueRobust": "true",
    "ICP_algorithm": "icpClassic",
    "corresponding_points_decimation": "5",
}
MAPPING = {
    "rawlog_offset": "0",
    "logOutput_dir": "LOG",
    "LOG_FREQUENCY": "1000000",
    "SAVE_3D_SCENE": "0",
    "SAVE_POSE_LOG": "0",
    "CAMERA_3DSCENE_FOLLOWS_ROBOT": "0",
    "SHOW_PROGRESS_3D_REAL_TIME": "0",
    "localizationLinDistance": "0.2",
    "localizationAngDistance": "5",
    "insertionLinDistance": "1.2",
    "insertionAngDistance": "45.0",
    "minICPgoodnessToAccept": "0.40",
    "matchAgainstTheGrid": "0",
    "occupancyGrid_count": "0",
    "pointsMap_count": "1",
    "likelihoodMapSelection": "-1",
}
"""Both as in MRPT's own demo, icp-slam_demo_classic.ini, without windows."""
POINTS = {"minDistBetweenLaserPoints": "0.05", "isPlanarMap": "1"}
TUNED_ICP = {
    "ICP_algorithm": "icpLevenbergMarquardt",
    "corresponding_points_decimation": "1",
    "thresholdDist": "0.5",
    "skip_quality_calculation": "false",
}
TUNED_MAPPING = {"insertionLinDistance": "0.4", "insertionAngDistance": "20.0"}


def solve(recording: Recording, settings: str, folder: Path) -> Array:
    """Poses ``(N, 3)`` of the robot. Raises ``RuntimeError`` where a program fails."""
    time = STAMP_SCALE * INTERVAL * np.arange(len(recording))
    carmen.write(folder / "a.log", replace(recording, time=time, odometry=None, attitude=None))
    (folder / "icp.ini").write_text(ini(settings), encoding="utf-8")
    _run(folder, "carmen2rawlog", "-q", "-i", "a.log", "-o", "a.rawlog")
    _run(folder, "icp-slam", "icp.ini", "a.rawlog")
    rows = np.loadtxt(folder / "LOG" / "log_estimated_path.txt", ndmin=2)
    if len(rows) != 2 * len(recording):
        raise RuntimeError(
            f"icp-slam wrote {len(rows)} poses, expected two for each of {len(recording)} scans"
        )
    poses: Array = rows[1::2, 1:4]  # dead reckoning and scan take turns
    return poses


def ini(settings: str) -> str:
    """The configuration file."""
    tuned = settings == "tuned"
    sections = {
        "ICP": ICP | (TUNED_ICP if tuned else {}),
        "MappingApplication": MAPPING | (TUNED_MAPPING if tuned else {}),
        "MappingApplication_pointsMap_00_insertOpts": POINTS,
    }
    lines = []
    for name, values in sections.items():
        lines += [f"[{name}]", *(f"{key} = {value}" for key, value in values.items())]
    return "\n".join(lines) + "\n"


def _run(folder: Path, *command: str) -> None:
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, stdin=subprocess.DEVNULL)
    if done.returncode:
        last = (done.stderr or done.stdout).strip().splitlines()[-1:]
        raise RuntimeError(f"{command[0]} ended with code {done.returncode}: {' '.join(last)[:200]}")
