"""Odometry factors: the steps between chosen scans as matching and dead reckoning have them, as a graph."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from slam import se2
from slam.graph.pose_graph import PoseGraph, WorldSteps
from slam.odometry.dead_reckoning import DeadReckoning
from slam.odometry.track import Track, Verdict
from slam.se2 import Array

LEAST_VARIANCE = 1e-8
"""Variance (m², rad²) of a step at rest, so that its inverse exists."""


@dataclass(frozen=True)
class OdometryFactorConfig:
    """How far the steps of a track are believed."""

    match_inflation: float = 25.0
    """Covariance inflation of a match: neighbouring points share their errors (an uneven floor, a bent wall),
    as if each range had five times its noise."""
    coasting_inflation: float = 100.0
    """Variance inflation of steps without dead reckoning, whose errors are one unknown speed and so fully
    correlated: it stands in for the correlation over the hundred steps of a few metres."""
    worst_variance: float = 1.0
    """Variance (m², rad²) of a direction a match says nothing about, while covariances are composed along the
    drive."""
    local_map_shift: float = 0.5
    """Metres after which the local map has changed enough for a match against it to be new evidence."""


def odometry_graph(
    reckoning: DeadReckoning,
    track: Track,
    rows: np.ndarray,
    config: OdometryFactorConfig = OdometryFactorConfig(),
) -> PoseGraph:
    """Graph over the scans ``rows (K,)``: what matching and dead reckoning say of each step from one to the
    next.

    Two edges a step: the track's, where matches count with their information and lost scans with the dead
    reckoning's, and the dead reckoning's own (for an INS its yaw; its position goes into the world steps).
    Across lost scans the track says nothing: there it repeats dead reckoning, and an INS's step, made in its
    world frame, was turned into a relative pose by a yaw that may be wrong by what a fall turned it.
    """
    pairs = np.stack([np.arange(len(rows) - 1), np.arange(1, len(rows))], axis=1)
    dead_reckoned = dead_reckoning_graph(reckoning, track.poses, rows, config)
    i, j = rows[:-1], rows[1:]
    matched = _match_covariances(track, config)
    covariances = [
        _step_covariance(reckoning, track, matched, int(a), int(b), config.local_map_shift)
        for a, b in zip(i, j, strict=True)
    ]
    information = np.linalg.inv(np.reshape(covariances, (-1, 3, 3)))
    lost = np.cumsum(track.verdict == Verdict.FELL_BACK)
    information[np.diff(lost[rows]) > 0] = 0.0
    steps = PoseGraph(
        track.poses[rows],
        pairs,
        se2.between(track.poses[i], track.poses[j]),
        information,
        world_steps=dead_reckoned.world_steps,
    )
    return steps.with_edges(
        dead_reckoned.edges,
        dead_reckoned.T_ij,
        dead_reckoned.information,
        heavy_tailed=dead_reckoned.heavy_tailed,
    )


def dead_reckoning_graph(
    reckoning: DeadReckoning,
    poses: Array,
    rows: np.ndarray,
    config: OdometryFactorConfig = OdometryFactorConfig(),
) -> PoseGraph:
    """Graph of dead reckoning alone over the scans ``rows (K,)``, placed at ``poses (N, 3)``.

    An INS's yaw has heavy tails: a fall turns it by ten degrees and more; so have wheels that were
    contradicted. Without dead reckoning each step is
    expected to be that of ``poses``, as surely as the time it took allows.
    """
    pairs = np.stack([np.arange(len(rows) - 1), np.arange(1, len(rows))], axis=1)
    at_rows = (poses if reckoning.absent else reckoning.poses)[rows]
    world_steps = WorldSteps()
    if reckoning.in_world:
        variance = reckoning.position_variance(np.diff(se2.path_length(reckoning.poses)[rows]))
        world_steps = WorldSteps(pairs, np.diff(reckoning.poses[rows, :2], axis=0), variance)
    return PoseGraph(
        poses=poses[rows],
        edges=pairs,
        T_ij=se2.between(at_rows[:-1], at_rows[1:]),
        information=_dead_reckoning_information(reckoning, rows, config),
        world_steps=world_steps,
        heavy_tailed=np.full(len(pairs), reckoning.in_world or reckoning.contradicted is not None),
    )


def step_covariance(
    reckoning: DeadReckoning, track: Track, first: int, config: OdometryFactorConfig
) -> Array:
    """Covariance ``(3, 3)`` of the last pose of a track as seen from its first, which is that of scan
    ``first``, in the body frame of the last."""
    matched, last = _match_covariances(track, config), len(track) - 1
    return _step_covariance(reckoning, track, matched, 0, last, config.local_map_shift, first)


def _match_covariances(track: Track, config: OdometryFactorConfig) -> Array:
    """Covariances ``(N, 3, 3)`` that matches add, bounded where they say nothing."""
    return np.linalg.inv(track.information / config.match_inflation + np.eye(3) / config.worst_variance)


def _step_covariance(
    reckoning: DeadReckoning,
    track: Track,
    matched: Array,
    i: int,
    j: int,
    local_map_shift: float,
    first: int = 0,
) -> Array:
    """Covariance in the body frame of row j of the track's step from row i, composed along the drive;
    ``matched (N, 3, 3)`` is what a match adds in its scan's; the track begins with scan ``first``."""
    terms: list[Array] = [np.eye(3) * LEAST_VARIANCE]
    at = [i]
    last, last_matched, since = i, i, 0.0
    verdict, place = track.verdict[i : j + 1].tolist(), track.poses[i : j + 1, :2].tolist()
    steps = [k for k in range(i + 1, j + 1) if verdict[k - i] != Verdict.SKIPPED]
    for k in steps:
        since += math.dist(place[last - i], place[k - i])
        if verdict[k - i] == Verdict.FELL_BACK:
            scans = (first + last_matched, first + last, first + k)
            terms.append(reckoning.lost_covariance(*scans, track.poses[k]))
            at.append(k)
        elif since >= local_map_shift or k == steps[-1]:
            terms.append(matched[k])
            at.append(k)
            since = 0.0
        last = k
        last_matched = last_matched if verdict[k - i] == Verdict.FELL_BACK else k
    return np.sum(se2.transport(terms, se2.between(track.poses[j], track.poses[at])), axis=0)


def _dead_reckoning_information(
    reckoning: DeadReckoning, rows: np.ndarray, config: OdometryFactorConfig
) -> Array:
    """Information ``(K - 1, 3, 3)`` of the recorded steps between the scans ``rows (K,)``, in the body frame
    of the later one, their covariances summed scan by scan; for an INS of its yaw alone."""
    if len(rows) < 2:
        return np.zeros((0, 3, 3))
    if reckoning.absent:
        return np.linalg.inv(config.coasting_inflation * reckoning.step_covariance(rows[:-1], rows[1:]))
    steps = np.arange(rows[0] + 1, rows[-1] + 1)
    covariance = reckoning.step_covariance(steps - 1, steps)
    if not reckoning.in_world:
        towards = reckoning.poses[rows[np.searchsorted(rows, steps)]]
        covariance = se2.transport(covariance, se2.between(towards, reckoning.poses[steps]))
    summed = np.add.reduceat(covariance, rows[:-1] - rows[0])
    if not reckoning.in_world:
        return np.linalg.inv(summed)
    information: Array = np.zeros_like(summed)
    information[:, 2, 2] = 1.0 / summed[:, 2, 2]
    return information
