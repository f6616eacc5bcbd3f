"""A submap on the common lattice: its walls as points, its free space by look-up."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from slam import se2
from slam.occupancy import Grid
from slam.se2 import Array
from slam.submap import Submap


@dataclass(frozen=True)
class Raster:
    """Cells ``occupied (H, W)`` and ``free (H, W)``; cell (0, 0) is cell ``first (2,)`` of the lattice.

    The lattice has cells of ``resolution`` m with one corner in the frame's origin. Free cells next to an
    occupied one are left out: half a wall's blur is not a conflict.
    """

    occupied: np.ndarray
    free: np.ndarray
    first: np.ndarray
    resolution: float


def wall_points(submap: Submap, resolution: float) -> Array:
    """Points ``(n, 2)`` m on the submap's walls in its own frame, one per cell of ``resolution`` m.

    Each is the mean of the submap's points in the cell, so that no lattice shows in the Hough transform.
    Points in cells the grid does not call occupied (seen through more often than hit) are left out.
    """
    points, grid = submap.points.points, submap.grid
    if len(points) == 0:
        return np.zeros((0, 2))
    height, width = grid.occupied.shape
    column, row = np.floor((points - grid.origin) / grid.resolution).astype(np.int64).T
    inside = (column >= 0) & (column < width) & (row >= 0) & (row < height)
    inside[inside] = grid.occupied[row[inside], column[inside]]
    return _thinned(points[inside], resolution)


def _thinned(points: Array, resolution: float) -> Array:
    """The mean of the points in each cell, in the order of the cells."""
    if len(points) == 0:
        return points
    cells = np.floor(points / resolution).astype(np.int64)
    cells -= cells.min(axis=0)
    key = cells[:, 1] * (cells[:, 0].max() + 1) + cells[:, 0]
    count = np.bincount(key)
    used = count > 0
    sums = [np.bincount(key, weights=points[:, axis])[used] for axis in (0, 1)]
    return np.stack(sums, -1) / count[used, None]


def rasterise(points: Array, grid: Grid, T: Array, resolution: float) -> Raster:
    """Wall points ``(n, 2)`` and the free space of their grid, both moved by ``T (3,)``.

    Walls are rotated as points, which leaves no holes; free space is looked up from each target cell.
    """
    from stitch.kernels import look_up

    x_min, x_max, y_min, y_max = grid.extent
    corners = np.array([[x_min, y_min], [x_max, y_min], [x_min, y_max], [x_max, y_max]])
    moved = se2.transform(T, corners) / resolution
    first = np.floor(moved.min(axis=0))
    width, height = (np.ceil(moved.max(axis=0)) - first).astype(int)
    occupied = np.zeros((height, width), dtype=bool)
    column, row = (np.floor(se2.transform(T, points) / resolution) - first).astype(int).T
    # a point on the border may round to either side of it
    occupied[np.clip(row, 0, height - 1), np.clip(column, 0, width - 1)] = True
    free = look_up(grid.free, grid.origin, grid.resolution, T, first, (height, width), resolution)
    return Raster(occupied, free & ~dilated(occupied), first, resolution)


def dilated(cells: np.ndarray) -> np.ndarray:
    """Cells ``(H, W)`` grown by one in all eight directions."""
    grown = cells.copy()
    grown[1:] |= cells[:-1]
    grown[:-1] |= cells[1:]
    out = grown.copy()
    out[:, 1:] |= grown[:, :-1]
    out[:, :-1] |= grown[:, 1:]
    return out
