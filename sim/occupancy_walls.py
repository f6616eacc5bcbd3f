"""Walls of a building from its occupancy map."""

from __future__ import annotations

import numpy as np

from sim.floorplan import WALL_HEIGHT, Prism, box
from slam import se2
from slam.mapping.occupancy import Grid
from slam.se2 import Array

TOLERANCE = 0.75
"""Outlines may leave the centres of the cells they follow by this many cells."""


def wall_lines(grid: Grid, tolerance: float = TOLERANCE) -> Array:
    """Segments ``(S, 4)`` m along the centres of the outermost cells of everything occupied.

    Outlines and holes of connected regions (Suzuki and Abe 1985, as OpenCV has it), made straight to within
    ``tolerance`` cells (Douglas and Peucker 1973). A lone cell gives a segment without length.
    """
    import cv2

    image = np.ascontiguousarray(grid.occupied, dtype=np.uint8)
    contours, _ = cv2.findContours(image, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
    lines = [np.empty((0, 4))]
    for contour in contours:
        corners = cv2.approxPolyDP(contour, tolerance, True)[:, 0, :].astype(np.float64)
        lines.append(np.hstack([corners, np.roll(corners, -1, axis=0)]))
    segments = np.vstack(lines)
    swap = (segments[:, 0] > segments[:, 2]) | (
        (segments[:, 0] == segments[:, 2]) & (segments[:, 1] > segments[:, 3])
    )
    segments[swap] = segments[swap][:, [2, 3, 0, 1]]
    segments = np.unique(segments, axis=0)  # the outline of a wall one cell thick goes there and back again
    return np.tile(grid.origin, 2) + (segments + 0.5) * grid.resolution


def walls(grid: Grid, height: float = WALL_HEIGHT, yaw: float = 0.0) -> list[Prism]:
    """Everything occupied as walls one cell thick and ``height`` m high, hollow where it is thicker; all
    turned by ``yaw`` rad about the origin."""
    prisms = []
    ends = se2.transform(np.array([0.0, 0.0, yaw]), wall_lines(grid).reshape(-1, 2))
    for x1, y1, x2, y2 in ends.reshape(-1, 4).tolist():
        length, yaw = float(np.hypot(x2 - x1, y2 - y1)), float(np.arctan2(y2 - y1, x2 - x1))
        centre = [0.5 * (x1 + x2), 0.5 * (y1 + y2), yaw]
        prisms.append(box(centre, length + grid.resolution, grid.resolution, z_hi=height, kind="wall"))
    return prisms
