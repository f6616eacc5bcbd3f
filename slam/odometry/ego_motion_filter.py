"""Things that move with the robot: somebody it follows, its own body, dust in front of the lens.

They stay where they are in the robot's frame while dead reckoning says that the robot moves, and hold a scan
matcher back.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from slam import se2
from slam.matching import Reference
from slam.recording import Recording
from slam.scan import Scan
from slam.se2 import Array

LOOK_BACK, MOST_BACK = 0.15, 20
"""A scan is compared with the last one from this way [m] before, at most so many scans ago."""
SAME = 0.05
"""A point this near [m] to one of the earlier scan, in the robot's frame, is in the same place."""
SHIFT = 0.08
"""A wall must have moved across its normal by this [m] to be told from what moves along."""


def without_companions(recording: Recording, scans: Sequence[Scan]) -> list[Scan]:
    """The scans without the points that moved with the robot.

    A wall seen at the same place in the robot's frame though the robot moved across it is none. With wheel
    odometry all scans stay as they are: a robot whose wheels slip would see nothing but companions.
    """
    return [without_companion_points(recording, scans, k) for k in range(len(scans))]


def without_companion_points(recording: Recording, scans: Sequence[Scan], k: int) -> Scan:
    """Scan k of `without_companions`, to which only ``scans`` up to k are looked at."""
    from slam.matching.neighbours import nearest_all

    if recording.source != "ins":
        return scans[k]
    first = max(0, k - MOST_BACK)
    way = np.linalg.norm(recording.dead_reckoning[first:k, :2] - recording.dead_reckoning[k, :2], axis=1)
    far = np.flatnonzero(way >= LOOK_BACK)
    if len(far) == 0 or len(scans[k]) == 0:
        return scans[k]
    j = first + int(far[-1])
    cloud, lattice = Reference(scans[j]).indexed
    same = nearest_all(cloud[0], lattice, scans[k].points, SAME) >= 0
    moved = _shift_across(scans[k], se2.between(recording.dead_reckoning[j], recording.dead_reckoning[k]))
    companion = same & ~(moved < SHIFT)
    return scans[k].selected(~companion) if companion.any() else scans[k]


def _shift_across(scan: Scan, T_before_now: Array) -> Array:
    """How far ``(n,)`` m each point's surface, were it at rest, came across its normal in the robot's frame;
    NaN where there is no normal."""
    before = se2.transform(T_before_now, scan.points)
    normals = scan.normals @ se2.rotation(T_before_now[2]).T
    return np.abs(np.sum((before - scan.points) * normals, axis=1))
