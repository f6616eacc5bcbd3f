"""A submap on the common lattice: its walls as points, its free space by look-up."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from slam import se2
from slam.mapping.occupancy import Grid, dilated
from slam.mapping.submap import Submap
from slam.se2 import Array
from stitch.alignment.config import WallConfig

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


@dataclass(frozen=True)
class Walls:
    """Points ``(n, 2)`` m on a submap's walls in its own frame, their mean normals ``facing (n, 2)``, shorter
    than 1 where normals differ or are unknown, their ``weights (n,)``, and its grid for the free space."""

    points: Array
    weights: Array
    facing: Array
    grid: Grid

    def raster(self, T: Array, resolution: float) -> Raster:
        """Walls and free space moved by ``T (3,)``, on the lattice."""
        return rasterise(self.points, self.grid, T, resolution, self.weights, self.facing)


def walls_of(submap: Submap, resolution: float, config: WallConfig = WallConfig()) -> Walls:
    """Walls and free space of a submap.

    One point per cell of ``resolution`` m: the mean of the submap's points in it, so that no lattice shows in
    the Hough transform. Those in cells the grid does not call occupied (seen through more often than hit) are
    left out.
    """
    grid, scan = submap.grid, submap.points
    points, facing = thin_points(
        scan.points, scan.normals, grid.occupied, grid.origin, grid.resolution, resolution
    )
    return Walls(points, wall_weights(points, resolution, config), facing, grid)


def wall_weights(points: Array, resolution: float, config: WallConfig) -> Array:
    """Weights ``(n,)`` of wall points ``(n, 2)`` m: 1 on a long wall, less on what may be furniture."""
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


@njit(cache=True, error_model="numpy")
def cells_of(points: Array, T: Array, first: Array, shape: tuple[int, int], resolution: float) -> np.ndarray:
    """Cells ``(n,)`` of a lattice ``shape`` at ``first``, counted row by row, that points ``(n, 2)`` moved by
    ``T (3,)`` lie in; the nearest one for those beside it."""
    c, s = np.cos(T[2]), np.sin(T[2])
    out = np.empty(points.shape[0], dtype=np.int64)
    for n in range(points.shape[0]):
        x, y = points[n, 0], points[n, 1]
        column = np.floor((c * x - s * y + T[0]) / resolution) - first[0]
        row = np.floor((s * x + c * y + T[1]) / resolution) - first[1]
        column, row = min(max(column, 0.0), shape[1] - 1.0), min(max(row, 0.0), shape[0] - 1.0)
        out[n] = np.int64(row) * shape[1] + np.int64(column)
    return out


@njit(cache=True, error_model="numpy")
def look_up(cells: np.ndarray, origin: Array, side: float, T: Array, first: Array, shape: tuple[int, int],
            resolution: float) -> np.ndarray:  # fmt: skip
    """Which cells of a lattice ``shape`` at ``first`` have their centre on a true cell of a map moved by T.

    The map's ``cells (H, W)`` of ``side`` m start at ``origin``; the lattice has cells of ``resolution`` m.
    """
    c, s = np.cos(T[2]), np.sin(T[2])
    height, width = cells.shape
    x = (first[0] + np.arange(shape[1]) + 0.5) * resolution - T[0]
    along, across = c * x, s * x
    rows, columns = np.empty(shape[1], dtype=np.int32), np.empty(shape[1], dtype=np.int32)
    out = np.zeros(shape, dtype=np.bool_)
    for row in range(shape[0]):
        y = (first[1] + row + 0.5) * resolution - T[1]
        for column in range(shape[1]):  # apart from the reading, so that it is vectorised
            rows[column] = np.int32(np.floor((c * y - across[column] - origin[1]) / side))
            columns[column] = np.int32(np.floor((along[column] + s * y - origin[0]) / side))
        for column in range(shape[1]):
            i, j = rows[column], columns[column]
            if 0 <= i < height and 0 <= j < width:
                out[row, column] = cells[i, j]
    return out


@njit(cache=True, error_model="numpy")
def thin_points(points: Array, normals: Array, occupied: np.ndarray, origin: Array, side: float,
                resolution: float) -> tuple[Array, Array]:  # fmt: skip
    """Mean ``(m, 2)`` of the points ``(n, 2)`` on occupied cells in each cell of ``resolution`` m, row by
    row, and the mean ``(m, 2)`` of their normals, NaN counting as zero.

    ``occupied (H, W)`` has cells of ``side`` m and starts at ``origin (2,)``.
    """
    height, width = occupied.shape
    # the thinned cells that the grid touches, and one more on either side for what rounding may do
    left, low = np.floor(origin[0] / resolution) - 1.0, np.floor(origin[1] / resolution) - 1.0
    columns = int(np.floor((origin[0] + width * side) / resolution) - left) + 2
    rows = int(np.floor((origin[1] + height * side) / resolution) - low) + 2
    slots = np.full(rows * columns, -1, dtype=np.int32)
    sums, used = np.empty((min(points.shape[0], rows * columns), 5)), 0
    for n in range(points.shape[0]):
        x, y = points[n, 0], points[n, 1]
        j, i = int(np.floor((x - origin[0]) / side)), int(np.floor((y - origin[1]) / side))
        if not (0 <= i < height and 0 <= j < width and occupied[i, j]):
            continue
        cell = int(np.floor(y / resolution) - low) * columns + int(np.floor(x / resolution) - left)
        slot = slots[cell]
        if slot < 0:
            slot = slots[cell] = used
            sums[slot, :] = 0.0
            used += 1
        sums[slot, 0] += x
        sums[slot, 1] += y
        sums[slot, 2] += 1.0
        if np.isfinite(normals[n, 0]):
            sums[slot, 3] += normals[n, 0]
            sums[slot, 4] += normals[n, 1]
    means, facing, k = np.empty((used, 2)), np.empty((used, 2)), 0
    for slot in slots:
        if slot >= 0:
            count = sums[slot, 2]
            means[k, 0], means[k, 1] = sums[slot, 0] / count, sums[slot, 1] / count
            facing[k, 0], facing[k, 1] = sums[slot, 3] / count, sums[slot, 4] / count
            k += 1
    return means, facing


@njit(cache=True)
def straight_run_lengths(occupied: np.ndarray, reach: int, directions: int) -> np.ndarray:
    """Length ``(H, W)`` in cells of the longest straight run through each occupied cell, at most 2 reach + 1;
    the search ends with the first run longer than ``reach``.

    A run goes in one of ``directions``, over cells that are occupied or next to one, and ends at the first
    that is not.
    """
    height, width = occupied.shape
    border = reach + 1  # that no run gets through
    near = np.zeros((height + 2 * border, width + 2 * border), dtype=np.bool_)
    for i in range(height):
        for j in range(width):
            if occupied[i, j]:
                near[border + i - 1 : border + i + 2, border + j] = True
                near[border + i, border + j - 1 : border + j + 2] = True
    near[reach], near[border + height], near[:, reach], near[:, border + width] = False, False, False, False
    across, near_cells = near.shape[1], near.ravel()
    steps = np.empty((directions, 2, reach), dtype=np.int64)
    for k in range(directions):
        c, s = np.cos(np.pi * k / directions), np.sin(np.pi * k / directions)
        for step in range(reach):
            steps[k, 0, step] = int(np.round((step + 1) * s)) * across + int(np.round((step + 1) * c))
            steps[k, 1, step] = -steps[k, 0, step]
    runs = np.zeros((height, width), dtype=np.int32)
    for i in range(height):
        for j in range(width):
            if not occupied[i, j]:
                continue
            at, longest = (border + i) * across + border + j, 0
            for k in range(directions):
                run = 1
                for way in range(2):
                    for step in range(reach):
                        if not near_cells[np.uint64(at + steps[k, way, step])]:
                            break
                        run += 1
                longest = max(longest, run)
                if longest > reach:
                    break
            runs[i, j] = longest
    return runs
