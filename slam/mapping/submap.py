"""A stretch of the drive as one rigid map."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from slam import se2
from slam.mapping import occupancy
from slam.mapping.occupancy import Grid
from slam.measurements import Measurements
from slam.scan import Scan
from slam.se2 import Array


@dataclass(frozen=True)
class Submap:
    """Scans ``start..stop-1`` of a drive in the frame of one anchor pose, that of scan ``start``.

    ``anchor (3,)`` is the anchor's pose in the map frame at the time of cutting; ``points`` and ``grid``
    are in the anchor's frame. They were drawn from the scans ``rows (K,)`` at ``T_anchor_scan (K, 3)``; none
    of these where the submap was not made of scans.
    """

    start: int
    stop: int
    anchor: Array
    points: Scan
    grid: Grid
    rows: np.ndarray = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    T_anchor_scan: Array = field(default_factory=lambda: np.zeros((0, 3)))


def cut(
    measurements: Measurements,
    scans: Sequence[Scan],
    poses: Array,
    start: int,
    stop: int,
    rows: np.ndarray,
    resolution: float = 0.1,
) -> Submap:
    """The submap of scans ``start..stop-1`` at ``poses (N, 3)``, drawn from those of the scans ``rows``
    among them.

    ``rows`` are indices of scans that may be trusted; those outside the stretch are left out. Raises
    ``ValueError`` when none is inside.
    """
    inside = rows[(rows >= start) & (rows < stop)]
    if len(inside) == 0:
        raise ValueError(f"submap {start}..{stop - 1}: none of its scans may be drawn")
    anchor = poses[start]
    local = se2.between(anchor, poses[inside])
    points = merge_scans([scans[k] for k in inside], local)
    grid = occupancy.draw(
        local, measurements.ranges[inside], measurements.angles, measurements.laser, resolution=resolution
    )
    return Submap(start, stop, anchor, points, grid, inside, local)


def merge_scans(scans: Sequence[Scan], T_anchor_scan: Array) -> Scan:
    """The points of K scans, which lie at ``T_anchor_scan (K, 3)``, in the anchor's frame."""
    return Scan.merged([scan.transformed(T) for scan, T in zip(scans, T_anchor_scan, strict=True)])
