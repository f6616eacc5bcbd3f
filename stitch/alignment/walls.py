"""The walls of a map without scans: points, tangents and normals read off its cells."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from slam.mapping.occupancy import Grid
from slam.scan import Scan
from slam.se2 import Array
from stitch.alignment.config import Amount, Checked, Count, Positive
from stitch.alignment.raster import dilated

ROUNDING = 1.0 / 12.0
"""Variance [cells²] of what a cell's centre rounds."""


@dataclass(frozen=True)
class SurfaceConfig(Checked):
    """How a wall's direction is read off the cells around each of its own."""

    radius: Positive = 0.3
    """Radius [m] of the cells that are read."""
    radius_cells: tuple[Positive, Positive] = (3.0, 12.0)
    """Least and largest radius in cells."""
    min_neighbours: Count = 4
    """Cells without which there is no direction."""
    max_scatter_ratio: Amount = 0.25
    """Variance across the wall over that along it, above which there is no direction."""


DEFAULT = SurfaceConfig()


def surfaces(grid: Grid, config: SurfaceConfig = DEFAULT) -> Scan:
    """Points on the surfaces of a grid's walls, in the grid's frame, as a laser would have left them.

    A surface cell becomes a point on the straight line through its neighbours (its centre where that would
    leave the wall), once for each side that is open, with the normal towards it; at the end of a wall for
    both. Where there is no line, it has neither tangent nor normal. The covariance is that of the cell's
    rounding.
    """
    from stitch.alignment.wall_kernels import lines_through

    open_cells = _open(grid)
    surface = grid.occupied & dilated(open_cells)
    cells = np.argwhere(surface)
    reach = float(np.clip(config.radius / grid.resolution, *config.radius_cells))
    mean, direction, scatter, count, sides = lines_through(surface, open_cells, cells, reach)
    straight = count >= config.min_neighbours
    straight &= scatter[:, 1] <= config.max_scatter_ratio * scatter[:, 0]
    tangent = np.stack([np.cos(direction), np.sin(direction)], -1)
    normal = np.stack([-tangent[:, 1], tangent[:, 0]], -1)
    centres = cells[:, ::-1] + 0.5
    on_line = centres + np.sum(mean * normal, axis=1, keepdims=True) * normal
    kept = straight & _inside(grid.occupied, on_line)
    points = grid.origin + np.where(kept[:, None], on_line, centres) * grid.resolution
    across = np.maximum(scatter[:, 1], ROUNDING)
    deviation = np.sqrt(across / (count * np.maximum(scatter[:, 0], ROUNDING)))
    rows, sign = _faces(straight, sides > 0)
    return Scan(
        points=points[rows],
        tangents=tangent[rows] * np.abs(sign[:, None]),
        normals=normal[rows] * sign[:, None],
        covariance=np.tile(ROUNDING * grid.resolution**2 * np.eye(2), (len(rows), 1, 1)),
        tangent_sigma=deviation[rows] * np.abs(sign),
        beams=np.arange(len(rows)),
    )


def _faces(straight: np.ndarray, seen: np.ndarray) -> tuple[np.ndarray, Array]:
    """Rows of the cells ``(m,)``, once for each face, and the side of the tangent it is on: 1 left, -1 right,
    NaN without a tangent. ``seen (n, 2)``: what is left and right is open."""
    neither = ~np.any(seen, axis=1)
    left, right = (np.flatnonzero(straight & (seen[:, side] | neither)) for side in (0, 1))
    rough = np.flatnonzero(~straight)
    sign = np.repeat([1.0, -1.0, np.nan], [len(left), len(right), len(rough)])
    return np.concatenate([left, right, rough]), sign


def _inside(cells: np.ndarray, points: Array) -> np.ndarray:
    """Which of the points ``(n, 2)``, in cells, lie in true cells."""
    column, row = np.floor(points).astype(np.int64).T
    within = (row >= 0) & (row < cells.shape[0]) & (column >= 0) & (column < cells.shape[1])
    within[within] = cells[row[within], column[within]]
    return within


def _open(grid: Grid) -> np.ndarray:
    """Cells that walls are seen from: free, or unknown and beside a free one, as where a map is not sure how
    far a wall reaches. In a map without free cells all that is no wall."""
    from scipy.ndimage import binary_dilation

    if not grid.free.any():
        return ~grid.occupied
    return binary_dilation(grid.free) & ~grid.occupied  # not across corners: that would be through walls
