"""A front end's track as the backbone of a pose graph: matched steps and dead reckoning between chosen
scans."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from slam import se2
from slam.graph.pose_graph import PoseGraph, WorldSteps
from slam.odometry import dead_reckoning
from slam.odometry.track import Track, Verdict
from slam.recording import Recording
from slam.se2 import Array

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
    matched = np.linalg.inv(track.information / SHARED_ERROR + np.eye(3) / WORST_VARIANCE)
    tracked = [
        _tracked_covariance(recording, track, matched, int(a), int(b)) for a, b in zip(i, j, strict=True)
    ]
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
    at_rows = (poses if recording.source == "none" else recording.dead_reckoning)[rows]
    return PoseGraph(
        poses=poses[rows],
        edges=pairs,
        T_ij=se2.between(at_rows[:-1], at_rows[1:]),
        information=_reckoned_information(recording, rows),
        world_steps=_world_steps(recording, rows, pairs) if recording.source == "ins" else None,
    )


def _tracked_covariance(recording: Recording, track: Track, matched: Array, i: int, j: int) -> Array:
    """Covariance in the body frame of scan j of the track's step from i, composed along the drive; ``matched
    (N, 3, 3)`` is what a match adds in its scan's."""
    terms: list[Array] = [np.eye(3) * LEAST_VARIANCE]
    at = [i]
    last, sure, since = i, i, 0.0
    verdict, place = track.verdict[i : j + 1].tolist(), track.poses[i : j + 1, :2].tolist()
    steps = [k for k in range(i + 1, j + 1) if verdict[k - i] != Verdict.SKIPPED]
    for k in steps:
        since += math.dist(place[last - i], place[k - i])
        if verdict[k - i] == Verdict.FELL_BACK:
            terms.append(dead_reckoning.lost_covariance(recording, sure, last, k, track.poses[k]))
            at.append(k)
        elif since >= LOCAL_MAP_SHIFT or k == steps[-1]:
            terms.append(matched[k])
            at.append(k)
            since = 0.0
        last = k
        sure = sure if verdict[k - i] == Verdict.FELL_BACK else k
    return np.sum(se2.transport(terms, se2.between(track.poses[j], track.poses[at])), axis=0)


def _reckoned_information(recording: Recording, rows: np.ndarray) -> Array:
    """Information ``(K - 1, 3, 3)`` of the recorded steps between the scans ``rows (K,)``, in the body frame
    of the later one, their covariances summed scan by scan; for an INS of its yaw alone."""
    if len(rows) < 2:
        return np.zeros((0, 3, 3))
    if recording.source == "none":
        return np.linalg.inv(SHARED_SPEED * dead_reckoning.step_covariance(recording, rows[:-1], rows[1:]))
    steps = np.arange(rows[0] + 1, rows[-1] + 1)
    covariance = dead_reckoning.step_covariance(recording, steps - 1, steps)
    if recording.source == "odometry":
        towards = recording.dead_reckoning[rows[np.searchsorted(rows, steps)]]
        covariance = se2.transport(covariance, se2.between(towards, recording.dead_reckoning[steps]))
    summed = np.add.reduceat(covariance, rows[:-1] - rows[0])
    if recording.source == "odometry":
        return np.linalg.inv(summed)
    information: Array = np.zeros_like(summed)
    information[:, 2, 2] = 1.0 / summed[:, 2, 2]
    return information


def _world_steps(recording: Recording, rows: np.ndarray, pairs: np.ndarray) -> WorldSteps:
    position = recording.dead_reckoning[rows, :2]
    path = se2.path_length(recording.dead_reckoning)[rows]
    variance = dead_reckoning.INS_WALK * np.diff(path) + dead_reckoning.INS_POSITION_FLOOR
    return WorldSteps(pairs, np.diff(position, axis=0), variance)
