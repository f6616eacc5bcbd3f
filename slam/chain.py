"""A front end's track as the backbone of a pose graph: matched steps and dead reckoning between chosen
scans."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np

from slam import dead_reckoning, se2
from slam.posegraph import PoseGraph, WorldSteps
from slam.recording import Recording
from slam.se2 import Array
from slam.track import Track, Verdict

SHARED_ERROR = 25.0
"""Neighbouring points share their errors (an uneven floor, a bent wall): a match's information is divided
by this, as if each range had five times its noise."""

SHARED_SPEED = 100.0
"""Steps without dead reckoning share their error, a speed nobody knows: each has so many times its
variance."""

LEAST_VARIANCE = 1e-8
"""Variance (m², rad²) of a step at rest, so that its inverse exists."""

WORST_VARIANCE = 1.0
"""Variance (m², rad²) of a direction a match says nothing about, while information is composed along the
drive."""

LOCAL_MAP_SHIFT = 0.5
"""Metres after which the local map has changed enough for a match against it to be new evidence."""


def backbone(recording: Recording, track: Track, rows: np.ndarray) -> PoseGraph:
    """Graph over the scans ``rows (K,)``: what matching and dead reckoning say of each step from one to
    the next.

    Two edges a step: the track's, where matches count with their information and lost scans with the dead
    reckoning's, and the dead reckoning's own (for an INS its yaw; its position goes into the world
    steps).
    """
    pairs = np.stack([np.arange(len(rows) - 1), np.arange(1, len(rows))], axis=1)
    reckoned = reckoning(recording, track.poses, rows)
    i, j = rows[:-1], rows[1:]
    tracked = [_tracked_covariance(recording, track, int(a), int(b)) for a, b in zip(i, j, strict=True)]
    return replace(
        reckoned,
        edges=np.concatenate([pairs, reckoned.edges]),
        T_ij=np.concatenate([se2.between(track.poses[i], track.poses[j]), reckoned.T_ij]),
        information=np.concatenate([np.linalg.inv(np.reshape(tracked, (-1, 3, 3))), reckoned.information]),
        loop=np.zeros(2 * len(pairs), dtype=bool),
    )


def reckoning(recording: Recording, poses: Array, rows: np.ndarray) -> PoseGraph:
    """Graph of dead reckoning alone over the scans ``rows (K,)``, placed at ``poses (N, 3)``.

    Without any, each step is expected to be that of ``poses``, as surely as the time it took allows.
    """
    pairs = np.stack([np.arange(len(rows) - 1), np.arange(1, len(rows))], axis=1)
    steps = pairwise(rows)
    information = [_reckoned_information(recording, int(i), int(j)) for i, j in steps]
    at_rows = (poses if recording.source == "none" else recording.dead_reckoning)[rows]
    return PoseGraph(
        poses=poses[rows],
        edges=pairs,
        T_ij=se2.between(at_rows[:-1], at_rows[1:]),
        information=np.reshape(information, (-1, 3, 3)),
        world_steps=_world_steps(recording, rows, pairs) if recording.source == "ins" else None,
    )


def _tracked_covariance(recording: Recording, track: Track, i: int, j: int) -> Array:
    """Covariance in the body frame of scan j of the track's step from i, composed along the drive."""
    covariance: Array = np.eye(3) * LEAST_VARIANCE
    last, sure, since = i, i, 0.0
    steps = [k for k in range(i + 1, j + 1) if track.verdict[k] != Verdict.SKIPPED]
    for k in steps:
        covariance = se2.transport(covariance, se2.between(track.poses[k], track.poses[last]))
        since += float(np.hypot(*(track.poses[k, :2] - track.poses[last, :2])))
        if track.verdict[k] == Verdict.FELL_BACK:
            lost = dead_reckoning.lost_covariance(recording, sure, last, k, track.poses[k])
            covariance = covariance + lost
        elif since >= LOCAL_MAP_SHIFT or k == steps[-1]:
            floor = np.eye(3) / WORST_VARIANCE
            covariance = covariance + np.linalg.inv(track.information[k] / SHARED_ERROR + floor)
            since = 0.0
        last = k
        sure = sure if track.verdict[k] == Verdict.FELL_BACK else k
    return se2.transport(covariance, se2.between(track.poses[j], track.poses[last]))


def _reckoned_information(recording: Recording, i: int, j: int) -> Array:
    """Information of the recorded step in the body frame of j, its covariance summed scan by scan; for an
    INS of its yaw alone."""
    if recording.source == "none":
        return np.linalg.inv(SHARED_SPEED * dead_reckoning.step_covariance(recording, i, j))
    reckoned = recording.dead_reckoning
    covariance: Array = np.zeros((3, 3))
    for k in range(i + 1, j + 1):
        covariance = se2.transport(covariance, se2.between(reckoned[k], reckoned[k - 1]))
        covariance = covariance + dead_reckoning.step_covariance(recording, k - 1, k)
    if recording.source == "odometry":
        return np.linalg.inv(covariance)
    return np.diag([0.0, 0.0, 1.0 / covariance[2, 2]])


def _world_steps(recording: Recording, rows: np.ndarray, pairs: np.ndarray) -> WorldSteps:
    position = recording.dead_reckoning[rows, :2]
    path = se2.path_length(recording.dead_reckoning)[rows]
    variance = dead_reckoning.INS_WALK * np.diff(path) + dead_reckoning.INS_POSITION_FLOOR
    return WorldSteps(pairs, np.diff(position, axis=0), variance)
