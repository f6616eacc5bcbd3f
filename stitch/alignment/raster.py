"""A submap on the common lattice: its walls as points, its free space by look-up."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from slam import se2
from slam.mapping.occupancy import Grid
from slam.mapping.submap import Submap
from slam.se2 import Array
from stitch.alignment.config import WallConfig

DEFAULT = WallConfig()

Window = tuple[slice, slice]


@dataclass(frozen=True)
class Raster:
    """Cells ``occupied (H, W)`` and ``free (H, W)``; cell (0, 0) is cell ``first (2,)`` of the lattice.

    The lattice has cells of ``resolution`` m with one corner in the frame's origin. ``weight (H, W)``: how
    much an occupied cell counts, None where all count the same. ``facing (2, H, W)``: the mean normal (x, y)
    of its wall times its weight, None where nothing is known of it.
    """

    occupied: np.ndarray
    free: np.ndarray
    first: np.ndarray
    resolution: float
    weight: np.ndarray | None = None
    facing: np.ndarray | None = None

    @property
    def walls(self) -> np.ndarray:
        """The walls as numbers ``(H, W)`` float32: their weights, 1 where nothing is said about them."""
        return self.occupied.astype(np.float32) if self.weight is None else self.weight


def wall_points(submap: Submap, resolution: float) -> tuple[Array, Array]:
    """Points ``(n, 2)`` m on the submap's walls, and their mean normals ``(n, 2)``, in its own frame.

    One per cell of ``resolution`` m: the mean of the submap's points in it, so that no lattice shows in the
    Hough transform. A mean normal is shorter than 1 where the points' normals differ or some have none.
    Points in cells the grid does not call occupied (seen through more often than hit) are left out.
    """
    from stitch.alignment.wall_kernels import thin_points

    grid, points = submap.grid, submap.points
    return thin_points(points.points, points.normals, grid.occupied, grid.origin, grid.resolution, resolution)


@dataclass(frozen=True)
class Walls:
    """A submap's `wall_points` ``(n, 2)`` with their mean normals ``facing (n, 2)``, their ``weights (n,)``,
    and its grid for the free space."""

    points: Array
    weights: Array
    facing: Array
    grid: Grid

    def raster(self, T: Array, resolution: float) -> Raster:
        """Walls and free space moved by ``T (3,)``, on the lattice."""
        return rasterise(self.points, self.grid, T, resolution, self.weights, self.facing)


def walls_of(submap: Submap, resolution: float, config: WallConfig = DEFAULT) -> Walls:
    """Walls and free space of a submap, one point per cell of ``resolution`` m."""
    points, facing = wall_points(submap, resolution)
    return Walls(points, wall_weights(points, resolution, config), facing, submap.grid)


def wall_weights(points: Array, resolution: float, config: WallConfig) -> Array:
    """Weights ``(n,)`` of wall points ``(n, 2)`` m: 1 on a long wall, less on what may be furniture."""
    from stitch.alignment.wall_kernels import straight_run_lengths

    if len(points) == 0:
        return np.zeros(0)
    cells = np.floor(points / resolution).astype(np.int64)
    cells -= cells.min(axis=0)
    occupied = np.zeros(cells.max(axis=0)[::-1] + 1, dtype=bool)
    occupied[cells[:, 1], cells[:, 0]] = True
    reach = round(config.furniture_length[1] / resolution)
    runs = straight_run_lengths(occupied, reach, config.run_directions)
    length = runs[cells[:, 1], cells[:, 0]] * resolution
    return np.interp(length, config.furniture_length, [config.furniture_weight, 1.0])


def rasterise(
    points: Array,
    grid: Grid,
    T: Array,
    resolution: float,
    weights: Array | None = None,
    facing: Array | None = None,
) -> Raster:
    """Wall points ``(n, 2)`` with ``weights (n,)`` and the free space of their grid, all moved by ``T (3,)``.

    Walls are rotated as points, which leaves no holes; free space is looked up from each target cell. Free
    cells next to an occupied one are left out: half a wall's blur is not a conflict. ``facing (n, 2)`` is
    drawn where there are weights too; of several points in a cell, that of the last.
    """
    from stitch.alignment.raster_kernels import cells_of, look_up

    first, shape = lattice_window(grid, T, resolution)
    occupied = np.zeros(shape, dtype=bool)
    # a point on the border may round to either side of it
    cells = cells_of(points, T, first, shape, resolution)
    occupied.reshape(-1)[cells] = True
    weight = None
    if weights is not None:
        weight = np.zeros(shape, dtype=np.float32)
        np.maximum.at(weight.reshape(-1), cells, weights.astype(np.float32))
    turned = None
    if facing is not None and weights is not None:
        turned = np.zeros((2, *shape), dtype=np.float32)
        for part, component in zip(turned, (weights[:, None] * facing @ se2.rotation(T[2]).T).T, strict=True):
            part.reshape(-1)[cells] = component
    free = look_up(grid.free, grid.origin, grid.resolution, T, first, shape, resolution)
    return Raster(occupied, free & ~dilated(occupied), first, resolution, weight, turned)


def lattice_window(grid: Grid, T: Array, resolution: float) -> tuple[Array, tuple[int, int]]:
    """First cell ``(2,)`` and shape of the part of the lattice that a grid moved by ``T (3,)`` covers."""
    x_min, x_max, y_min, y_max = grid.extent
    corners = np.array([[x_min, y_min], [x_max, y_min], [x_min, y_max], [x_max, y_max]])
    moved = se2.transform(T, corners) / resolution
    first = np.floor(moved.min(axis=0))
    width, height = (np.ceil(moved.max(axis=0)) - first).astype(int).tolist()
    return first, (height, width)


def common_windows(a: Raster, b: Raster) -> tuple[Window, Window] | None:
    """Where the cells that two rasters of one lattice have in common lie, in a and in b; None without any."""
    low = np.maximum(a.first, b.first)
    high = np.minimum(a.first + a.occupied.shape[::-1], b.first + b.occupied.shape[::-1])
    if np.any(high <= low):
        return None
    (x_a, y_a), (x_b, y_b) = ((low - raster.first).astype(int).tolist() for raster in (a, b))
    width, height = (high - low).astype(int).tolist()
    return np.s_[y_a : y_a + height, x_a : x_a + width], np.s_[y_b : y_b + height, x_b : x_b + width]


def dilated(cells: np.ndarray) -> np.ndarray:
    """Cells ``(H, W)`` grown by one in all eight directions."""
    grown = cells.copy()
    grown[1:] |= cells[:-1]
    grown[:-1] |= cells[1:]
    out = grown.copy()
    out[:, 1:] |= grown[:, :-1]
    out[:, :-1] |= grown[:, 1:]
    return out
