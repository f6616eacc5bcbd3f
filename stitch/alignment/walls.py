"""The walls of a map without scans: points, tangents and normals read off its cells."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from scipy.ndimage import binary_dilation

from slam.mapping.occupancy import Grid, dilated
from slam.scan import Scan
from slam.se2 import Array
from stitch.alignment.config import Amount, Checked, Count, Positive

ROUNDING = 1.0 / 12.0
"""Variance [cells²] of what a cell's centre rounds."""
BESIDE = 0.38
"""Sine of the angle between a wall and the way to a neighbouring cell, from which the cell is beside it."""


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


def surfaces(grid: Grid, config: SurfaceConfig = SurfaceConfig()) -> Scan:
    """Points on the surfaces of a grid's walls, in the grid's frame, as a laser would have left them.

    A surface cell becomes a point on the straight line through its neighbours (its centre where that would
    leave the wall), once for each side that is open, with the normal towards it; at the end of a wall for
    both. Where there is no line, it has neither tangent nor normal. The covariance is that of the cell's
    rounding.
    """
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
    height, width = grid.occupied.shape
    column, row = np.floor(on_line).astype(np.int64).T + 1
    kept = straight & np.pad(grid.occupied, 1)[row.clip(0, height + 1), column.clip(0, width + 1)]
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


@njit(cache=True)
def lines_through(surface: np.ndarray, open_cells: np.ndarray, cells: np.ndarray, reach: float):
    """Principal axis of the surface cells within ``reach`` cells of each of ``cells (n, 2)``.

    Returns, in cells: the mean (column, row) of the neighbours relative to the cell ``(n, 2)``, the line's
    direction ``(n,)`` rad, the scatter along and across it ``(n, 2)`` (variances), the neighbours ``(n,)``,
    and the open cells touching the cell left and right of that direction ``(n, 2)``.
    """
    n, r = len(cells), int(reach)
    mean, scatter = np.zeros((n, 2)), np.zeros((n, 2))
    direction, count, sides = np.zeros(n), np.zeros(n, np.int64), np.zeros((n, 2), np.int64)
    for p in range(n):
        row, column = cells[p]
        sx = sy = sxx = sxy = syy = 0.0
        for i in range(max(row - r, 0), min(row + r + 1, surface.shape[0])):
            for j in range(max(column - r, 0), min(column + r + 1, surface.shape[1])):
                x, y = j - column, i - row
                if surface[i, j] and x * x + y * y <= reach * reach:
                    count[p] += 1
                    sx, sy = sx + x, sy + y
                    sxx, sxy, syy = sxx + x * x, sxy + x * y, syy + y * y
        k = float(count[p])
        sx, sy = sx / k, sy / k
        xx, xy, yy = sxx / k - sx * sx, sxy / k - sx * sy, syy / k - sy * sy
        mean[p, 0], mean[p, 1] = sx, sy
        direction[p] = 0.5 * np.arctan2(2.0 * xy, xx - yy)
        spread = np.sqrt(0.25 * (xx - yy) ** 2 + xy * xy)
        scatter[p, 0], scatter[p, 1] = 0.5 * (xx + yy) + spread, max(0.5 * (xx + yy) - spread, 0.0)
        c, s = np.cos(direction[p]), np.sin(direction[p])
        for i in range(max(row - 1, 0), min(row + 2, surface.shape[0])):
            for j in range(max(column - 1, 0), min(column + 2, surface.shape[1])):
                if open_cells[i, j]:
                    across = (c * (i - row) - s * (j - column)) / np.hypot(i - row, j - column)
                    sides[p, 0] += across > BESIDE
                    sides[p, 1] += across < -BESIDE
    return mean, direction, scatter, count, sides


def _faces(straight: np.ndarray, seen: np.ndarray) -> tuple[np.ndarray, Array]:
    """Rows of the cells ``(m,)``, once for each face, and the side of the tangent it is on: 1 left, -1 right,
    NaN without a tangent. ``seen (n, 2)``: what is left and right is open."""
    neither = ~np.any(seen, axis=1)
    left, right = (np.flatnonzero(straight & (seen[:, side] | neither)) for side in (0, 1))
    rough = np.flatnonzero(~straight)
    sign = np.repeat([1.0, -1.0, np.nan], [len(left), len(right), len(rough)])
    return np.concatenate([left, right, rough]), sign


def _open(grid: Grid) -> np.ndarray:
    """Cells that walls are seen from: free, or unknown and beside a free one, as where a map is not sure how
    far a wall reaches. In a map without free cells all that is no wall."""
    if not grid.free.any():
        return ~grid.occupied
    return binary_dilation(grid.free) & ~grid.occupied  # not across corners: that would be through walls
