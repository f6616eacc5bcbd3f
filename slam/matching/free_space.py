"""Free space violated: points of a scan where other scans' beams passed through."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from slam import se2
from slam.scan import Scan
from slam.se2 import Array


@dataclass(frozen=True)
class Sight:
    """What a laser saw from one place: its pose ``T_map_laser (3,)``, and the ``bearings (n,)`` rad,
    ascending, and ``ranges (n,)`` m of what returned."""

    T_map_laser: Array
    bearings: Array
    ranges: Array

    @classmethod
    def of(cls, scan: Scan, T_map_robot: Array, T_robot_laser: Array) -> Sight:
        """Of a ``scan`` in the robot's frame, taken where the robot was at ``T_map_robot (3,)``."""
        points = se2.transform(se2.inverse(T_robot_laser), scan.points)
        bearings = np.arctan2(points[:, 1], points[:, 0])
        order = np.argsort(bearings)
        ranges = np.hypot(points[:, 0], points[:, 1])
        return cls(se2.compose(T_map_robot, T_robot_laser), bearings[order], ranges[order])


def violations(sights: Sequence[Sight], points: Array, gap: float, margin: float) -> tuple[int, int]:
    """How many of ``points (n, 2)`` m lie where the ``sights`` looked, and how many of these in free space.

    A point was looked at where beams less than ``gap`` rad from it returned from no nearer than ``margin`` m
    before it; it violates free space where both beams beside it went on for more than ``margin`` m behind it,
    in more than half of the sights that looked there.
    """
    from slam.matching.kernels import look

    looked = np.zeros(len(points), dtype=np.int64)
    free = np.zeros(len(points), dtype=np.int64)
    for sight in sights:
        if len(sight.ranges) > 1:
            local = se2.transform(se2.inverse(sight.T_map_laser), points)
            look(sight.bearings, sight.ranges, np.ascontiguousarray(local), gap, margin, looked, free)
    return int(np.count_nonzero(looked)), int(np.count_nonzero(2 * free > looked))
