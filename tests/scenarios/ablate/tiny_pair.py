"""Two maps of a tiny building, for what learns from pairs."""

from __future__ import annotations

import numpy as np

from scenarios.ablate.pair_sampling import SubmapPair
from sim.laser import Raycaster
from slam import se2
from slam.mapping.occupancy import draw
from slam.mapping.submap import Submap
from slam.recording import Laser
from slam.scan import Scan
from slam.se2 import Array

ANGLES = np.radians(np.arange(-180.0, 180.0, 2.0))
LASER = Laser(range_max=8.0)
FRAMES = np.array([[2.0, 2.0, 0.3], [6.0, 2.0, -1.4]])
"""Of the two maps of the tiny building, in the building."""


def tiny_building() -> Raycaster:
    """Three rooms in a row with doors and a pillar each, none like another."""
    walls = [[0.0, 0.0, 11.0, 0.0], [0.0, 4.0, 11.0, 4.0], [0.0, 0.0, 0.0, 4.0], [11.0, 0.0, 11.0, 4.0]]
    walls += [[4.0, 0.0, 4.0, 1.5], [4.0, 2.7, 4.0, 4.0], [8.0, 0.0, 8.0, 2.2], [8.0, 3.4, 8.0, 4.0]]
    walls += [[1.0, 3.0, 1.8, 3.0], [5.2, 0.8, 5.2, 1.6], [5.2, 1.6, 6.8, 1.6], [9.5, 2.0, 9.9, 2.9]]
    return Raycaster.from_segments(np.array(walls))


def submap(building: Raycaster, frame: Array, x: Array, rng: np.random.Generator) -> Submap:
    """What is seen from places ``x`` along the middle of the rooms."""
    poses = np.column_stack([x, np.full(len(x), 2.3), x])
    ranges = building.cast(poses, ANGLES)
    ranges = np.where(ranges < LASER.range_max, ranges, np.nan) + rng.normal(0.0, 0.01, ranges.shape)
    local = se2.between(frame, poses)
    scans = [Scan.from_ranges(r, ANGLES, LASER).transformed(T) for r, T in zip(ranges, local, strict=True)]
    return Submap(0, len(x), frame, Scan.merged(scans), draw(local, ranges, ANGLES, LASER, 0.05))


def tiny_pair() -> SubmapPair:
    """Two drives that share half of it."""
    rng, building = np.random.default_rng(0), tiny_building()
    a, b = (
        submap(building, frame, np.linspace(*ends, 12), rng)
        for frame, ends in zip(FRAMES, [(0.7, 7.0), (4.6, 10.5)], strict=True)
    )
    middle = se2.transform(se2.inverse(FRAMES[1]), np.array([[6.0, 2.0]]))[0]
    return SubmapPair("tiny", 200, "50 %", a, b, se2.between(*FRAMES), middle, 0.5, False, 4.0)
