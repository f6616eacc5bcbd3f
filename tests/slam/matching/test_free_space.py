"""Points in space that others saw free: the kernel against the obvious loops, and a room."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from slam import se2
from slam.matching.free_space import Sight, violations
from slam.scan import Scan
from slam.se2 import Array

GAP, MARGIN = np.radians(1.5), 0.3


def slow_violations(sights: list[Sight], points: Array) -> tuple[int, int]:
    looked, free = np.zeros(len(points), int), np.zeros(len(points), int)
    for sight in sights:
        for n, (x, y) in enumerate(se2.transform(se2.inverse(sight.T_map_laser), points)):
            bearing, distance = np.arctan2(y, x), np.hypot(x, y)
            after = next((i for i, b in enumerate(sight.bearings) if b >= bearing), len(sight.bearings))
            after = min(max(after, 1), len(sight.bearings) - 1)
            beside = [after - 1, after]
            if min(abs(sight.bearings[i] - bearing) for i in beside) > GAP:
                continue
            if distance < max(sight.ranges[i] for i in beside) + MARGIN:
                looked[n] += 1
                free[n] += distance < min(sight.ranges[i] for i in beside) - MARGIN
    return int(np.sum(looked > 0)), int(np.sum(2 * free > looked))


def test_the_kernel_counts_as_the_obvious_loops_do(room: Array, look: Callable[..., Scan]) -> None:
    rng = np.random.default_rng(0)
    mount = np.array([0.1, 0.02, 0.3])
    poses = np.array([[2.0, 2.0, 0.3], [2.5, 2.2, 0.9], [3.0, 3.4, -0.4]])
    sights = [Sight.of(look(room, se2.compose(p, mount)).transformed(mount), p, mount) for p in poses]
    points = rng.uniform([-1.0, -1.0], [9.0, 7.0], (400, 2))
    counted = violations(sights, points, GAP, MARGIN)
    assert counted == slow_violations(sights, points)
    assert 0 < counted[1] < counted[0] < 400


def test_walls_violate_where_the_pose_is_wrong_only(room: Array, look: Callable[..., Scan]) -> None:
    here = np.array([2.0, 2.0, 0.3])
    scan = look(room, here)
    sights = [Sight.of(scan, here, np.zeros(3))]
    right, wrong = (
        violations(sights, se2.transform(pose, scan.points), GAP, MARGIN)
        for pose in (here, se2.compose(here, [-0.8, 0.0, 0.0]))
    )
    assert right == (len(scan), 0)
    assert wrong[1] > 0.3 * wrong[0]


def test_a_laser_that_saw_nothing_tells_nothing(look: Callable[..., Scan]) -> None:
    nothing = Sight.of(look(np.zeros((0, 4)), np.zeros(3)), np.zeros(3), np.zeros(3))
    assert violations([nothing], np.ones((5, 2)), GAP, MARGIN) == (0, 0)
    assert violations([], np.ones((5, 2)), GAP, MARGIN) == (0, 0)
