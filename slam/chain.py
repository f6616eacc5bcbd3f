"""A front end's track as the backbone of a pose graph: matched steps and dead reckoning between chosen scans."""

from __future__ import annotations

import numpy as np

from slam import dead_reckoning, se2
from slam.posegraph import PoseGraph, WorldSteps
from slam.recording import Recording
from slam.se2 import Array
from slam.track import Track, Verdict

SHARED_ERROR = 25.0
"""Neighbouring points share their errors (an uneven floor, a bent wall): a match's information is divided by this,
as if each range had five times its noise."""

WORST_VARIANCE = 1.0
"""Variance (m², rad²) of a direction a match says nothing about, while information is composed along the drive."""

LOCAL_MAP_SHIFT = 0.5
"""Metres after which the local map has changed enough for a match against it to be new evidence."""


def backbone(recording: Recording, track: Track, rows: np.ndarray) -> PoseGraph:
    """Graph over the scans ``rows (K,)``: what matching and dead reckoning say of each step from one to the next."""
    pairs = np.stack([np.arange(len(rows) - 1), np.arange(1, len(rows))], axis=1)
    T, information, edges = [], [], []
    for a, b in pairs:
        i, j = int(rows[a]), int(rows[b])
        matched = _matched_information(track, i, j)
        if matched is not None:
            edges.append((a, b))
            T.append(se2.between(track.poses[i], track.poses[j]))
            information.append(matched)
        edges.append((a, b))
        T.append(se2.between(recording.dead_reckoning[i], recording.dead_reckoning[j]))
        information.append(_reckoned_information(recording, i, j))
    return PoseGraph(
        poses=track.poses[rows],
        edges=np.array(edges, dtype=np.int64).reshape(-1, 2),
        T_ij=np.array(T).reshape(-1, 3),
        information=np.array(information).reshape(-1, 3, 3),
        world_steps=_world_steps(recording, rows, pairs) if recording.source == "ins" else None,
    )


def _matched_information(track: Track, i: int, j: int) -> Array | None:
    """Information in the body frame of scan j that matching has of the pose at j seen from i; None if it broke."""
    steps = [k for k in range(i + 1, j + 1) if track.verdict[k] != Verdict.SKIPPED]
    if not steps or any(track.verdict[k] == Verdict.FELL_BACK for k in steps):
        return None
    floor = np.eye(3) / WORST_VARIANCE
    covariance, last, since = np.zeros((3, 3)), i, 0.0
    for k in steps:
        since += float(np.hypot(*(track.poses[k, :2] - track.poses[last, :2])))
        covariance = se2.transport(covariance, se2.between(track.poses[k], track.poses[last]))
        last = k
        if since >= LOCAL_MAP_SHIFT or k == steps[-1]:
            covariance = covariance + np.linalg.inv(track.information[k] / SHARED_ERROR + floor)
            since = 0.0
    covariance = se2.transport(covariance, se2.between(track.poses[j], track.poses[last]))
    return np.linalg.inv(covariance)


def _reckoned_information(recording: Recording, i: int, j: int) -> Array:
    """Information of the recorded step in the body frame of j; for an INS of its yaw alone."""
    covariance = dead_reckoning.step_covariance(recording, i, j)
    if recording.source == "odometry":
        return np.linalg.inv(covariance)
    return np.diag([0.0, 0.0, 1.0 / covariance[2, 2]])


def _world_steps(recording: Recording, rows: np.ndarray, pairs: np.ndarray) -> WorldSteps:
    position = recording.dead_reckoning[rows, :2]
    path = se2.path_length(recording.dead_reckoning)[rows]
    variance = dead_reckoning.INS_WALK * np.diff(path) + dead_reckoning.INS_POSITION_FLOOR
    return WorldSteps(pairs, np.diff(position, axis=0), variance)
