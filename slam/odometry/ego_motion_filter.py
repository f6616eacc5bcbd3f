"""Ego-motion filter: takes out what moves with the robot (somebody it follows, its own body, dust in front of
the lens).

Such points stay where they are in the robot's frame while dead reckoning says that the robot moves, and hold
a scan matcher back.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from slam import se2
from slam.matching import Reference
from slam.measurements import Measurements
from slam.scan import Scan
from slam.se2 import Array


@dataclass(frozen=True)
class EgoMotionFilterConfig:
    """With which earlier scan a scan is compared, and when a point counts as moving along."""

    min_shift: float = 0.15
    """A scan is compared with the last one from this way [m] before."""
    max_scans: int = 20
    """At most so many scans before."""
    same_place: float = 0.05
    """A point this near [m] to one of the earlier scan, in the robot's frame, is in the same place."""
    wall_shift: float = 0.08
    """A wall must have moved across its normal by this [m] to be told from what moves along."""


def remove_co_moving_points(
    measurements: Measurements,
    scans: Sequence[Scan],
    config: EgoMotionFilterConfig = EgoMotionFilterConfig(),
) -> list[Scan]:
    """The scans without the points that moved with the robot.

    A wall seen at the same place in the robot's frame though the robot moved across it moves along. With
    wheel odometry all scans stay as they are: a robot whose wheels slip would take every point for one.
    """
    return [filter_scan(measurements, scans, k, config) for k in range(len(scans))]


def filter_scan(
    measurements: Measurements, scans: Sequence[Scan], k: int, config: EgoMotionFilterConfig
) -> Scan:
    """Scan k of `remove_co_moving_points`, which looks at ``scans`` up to k only."""
    from slam.matching.neighbours import nearest_all

    if measurements.source != "ins":
        return scans[k]
    poses, first = measurements.dead_reckoning, max(0, k - config.max_scans)
    way = np.linalg.norm(poses[first:k, :2] - poses[k, :2], axis=1)
    far = np.flatnonzero(way >= config.min_shift)
    if len(far) == 0 or len(scans[k]) == 0:
        return scans[k]
    j = first + int(far[-1])
    cloud, lattice = Reference(scans[j]).indexed
    same = nearest_all(cloud[0], lattice, scans[k].points, config.same_place) >= 0
    shift = _shift_across(scans[k], se2.between(poses[j], poses[k]))
    co_moving = same & ~(shift < config.wall_shift)
    return scans[k].selected(~co_moving) if co_moving.any() else scans[k]


def _shift_across(scan: Scan, T_before_now: Array) -> Array:
    """How far ``(n,)`` m each point's surface, were it at rest, came across its normal in the robot's frame;
    NaN where there is no normal."""
    before = se2.transform(T_before_now, scan.points)
    normals = scan.normals @ se2.rotation(T_before_now[2]).T
    return np.abs(np.sum((before - scan.points) * normals, axis=1))
