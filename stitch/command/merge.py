"""Maps whose poses are known, as one grid."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from slam import se2
from slam.mapping.occupancy import MAX_CELLS, Grid
from slam.se2 import Array


def canvas(grids: Sequence[Grid], poses: Sequence[Array], resolution: float) -> Grid:
    """An unknown grid with room for what is known of ``grids`` at ``poses``, each ``(3,)``.

    It shares the cell borders of the first of them. Raises ``ValueError`` when it would have more cells than
    `slam.mapping.occupancy.MAX_CELLS`.
    """
    corners = np.concatenate([se2.transform(T, _outline(grid)) for grid, T in zip(grids, poses, strict=True)])
    cells = (corners - grids[0].origin) / resolution
    first, last = np.floor(cells.min(axis=0) + 1e-6), np.ceil(cells.max(axis=0) - 1e-6)
    columns, rows = last - first
    if not rows * columns <= MAX_CELLS:
        raise ValueError(
            f"a merged map of {columns:.0f} x {rows:.0f} cells is too large, at most {MAX_CELLS:,} cells"
        )
    unknown = np.zeros((int(rows), int(columns)), dtype=bool)
    return Grid(unknown, unknown, grids[0].origin + first * resolution, resolution)


def _outline(grid: Grid) -> Array:
    """Corners ``(n, 2)`` m of the first and the last known cell of every row: all others lie between them."""
    known = grid.occupied | grid.free
    rows = np.flatnonzero(known.any(axis=1))
    first, last = known[rows].argmax(axis=1), known.shape[1] - known[rows, ::-1].argmax(axis=1)
    corners = [np.stack([x, y], -1) for x in (first, last) for y in (rows, rows + 1)]
    return grid.origin + np.concatenate(corners) * grid.resolution


def place(grid: Grid, T: Array, onto: Grid) -> Grid:
    """A grid moved by ``T (3,)`` onto the cells of another.

    Occupied cells are moved as points, dense enough to leave no holes; free space is looked up from the
    centre of each target cell.
    """
    from stitch.alignment.raster_kernels import look_up

    height, width = onto.occupied.shape
    points = se2.transform(T, _dense_points(grid, onto.resolution))
    column, row = np.floor((points - onto.origin) / onto.resolution).astype(np.int64).T
    occupied = np.zeros((height, width), dtype=bool)
    # a point on the border may round to either side of it
    occupied[np.clip(row, 0, height - 1), np.clip(column, 0, width - 1)] = True
    shifted = np.array([*(T[:2] - onto.origin), T[2]])
    free = look_up(
        grid.free, grid.origin, grid.resolution, shifted, np.zeros(2), (height, width), onto.resolution
    )
    return Grid(occupied, free & ~occupied, onto.origin, onto.resolution)


def _dense_points(grid: Grid, spacing: float) -> Array:
    """Points ``(n, 2)`` m over the occupied cells, at most ``spacing`` m apart."""
    split = int(np.ceil(grid.resolution / spacing - 1e-6))
    offsets = ((np.arange(split) + 0.5) / split - 0.5) * grid.resolution
    dx, dy = (part.ravel() for part in np.meshgrid(offsets, offsets))
    return (grid.occupied_points()[:, None] + np.stack([dx, dy], -1)).reshape(-1, 2)


def merge(layers: Sequence[Grid]) -> Grid:
    """Grids of one canvas as one: a cell is occupied where any of them is, and else free where any is.

    Where the maps contradict each other the wall stays: somebody may want to drive there.
    """
    occupied = np.any([layer.occupied for layer in layers], axis=0)
    free = np.any([layer.free for layer in layers], axis=0)
    return Grid(occupied, free & ~occupied, layers[0].origin, layers[0].resolution)
