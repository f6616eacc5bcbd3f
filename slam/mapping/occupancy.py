"""Occupied, free and unknown: a grid drawn by tracing every beam from the laser to what it hit."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from slam import se2
from slam.recording import Laser
from slam.se2 import Array

MAX_CELLS = 100_000_000
"""Larger grids are refused: they come from a wrong pose or range, not from a building."""


@dataclass(frozen=True)
class Grid:
    """Cells ``occupied (H, W)`` and ``free (H, W)``, never both; neither is unknown. Row is y, column is x.

    ``origin (2,)`` m is the lower left corner of cell (0, 0), ``resolution`` m the side of a cell. A grid
    drawn here has its origin at a multiple of the resolution, so that grids of one frame share their cell
    borders.
    """

    occupied: np.ndarray
    free: np.ndarray
    origin: Array
    resolution: float

    def __post_init__(self) -> None:
        if self.occupied.ndim != 2 or self.occupied.shape != self.free.shape:
            raise ValueError(
                f"grid: occupied {self.occupied.shape} and free {self.free.shape} must be one (H, W)"
            )
        if not self.resolution > 0.0:
            raise ValueError(f"grid: expected resolution > 0, got {self.resolution}")

    @property
    def extent(self) -> tuple[float, float, float, float]:
        """``(x_min, x_max, y_min, y_max)`` m, the order of matplotlib's ``imshow``."""
        (height, width), (x, y) = self.occupied.shape, self.origin
        return float(x), float(x + width * self.resolution), float(y), float(y + height * self.resolution)

    def occupied_points(self) -> Array:
        """Centres ``(n, 2)`` m of the occupied cells."""
        rows, columns = np.nonzero(self.occupied)
        return self.origin + (np.stack([columns, rows], -1) + 0.5) * self.resolution


def dilated(cells: np.ndarray) -> np.ndarray:
    """Cells ``(H, W)`` grown by one in all eight directions."""
    grown = cells.copy()
    grown[1:] |= cells[:-1]
    grown[:-1] |= cells[1:]
    out = grown.copy()
    out[:, 1:] |= grown[:, :-1]
    out[:, :-1] |= grown[:, 1:]
    return out


def draw(
    poses: Array,
    ranges: Array,
    angles: Array,
    laser: Laser,
    resolution: float = 0.05,
    *,
    min_hits: int = 1,
    min_share: float = 0.1,
) -> Grid:
    """Grid of scans ``ranges (N, B)`` m at beam ``angles (B,)`` rad, seen from robot ``poses (N, 3)``.

    A cell is occupied when at least ``min_hits`` beams ended in it and they are at least ``min_share`` of all
    beams that reached it: low enough for a wall to survive the beams that graze it, high enough for what has
    moved away to vanish. A cell is free when a beam went through it and it is not occupied. A beam without
    return (NaN, or outside the laser's limits) may have met glass, smoke or nothing, and clears nothing.

    Raises ``ValueError`` for poses that are not finite, shapes that disagree, or a grid beyond `MAX_CELLS`.
    """
    from slam.mapping.ray_tracing import count

    if not (resolution > 0.0 and min_hits >= 1):
        raise ValueError(
            f"drawing: expected resolution > 0 and min_hits >= 1, got {resolution} and {min_hits}"
        )
    starts, ends = _rays(poses, ranges, angles, laser)
    starts, ends = starts / resolution, ends / resolution
    first, shape = _lattice(starts, ends)
    hits, passes = count(starts, ends, first, shape)
    occupied = (hits >= min_hits) & (hits >= min_share * (hits + passes))
    return Grid(occupied, (passes > 0) & ~occupied, first * resolution, resolution)


def _rays(poses: Array, ranges: Array, angles: Array, laser: Laser) -> tuple[Array, Array]:
    """Where the beams start ``(N, 2)`` and end ``(N, B, 2)`` [m], NaN without return."""
    poses, ranges, angles = (np.asarray(value, dtype=np.float64) for value in (poses, ranges, angles))
    if len(poses) == 0:
        raise ValueError("drawing: expected at least one pose")
    if ranges.shape != (len(poses), len(angles)):
        raise ValueError(f"drawing: expected ranges {(len(poses), len(angles))}, got {ranges.shape}")
    if not np.all(np.isfinite(poses)):
        raise ValueError("drawing: expected finite poses")
    T_map_laser = se2.compose(poses, laser.T_robot_laser)
    seen = (ranges >= laser.range_min) & (ranges < laser.range_max)  # False for NaN
    r = np.where(seen, ranges, np.nan)
    bearing = T_map_laser[:, 2:] + angles
    starts = np.ascontiguousarray(T_map_laser[:, :2])
    return starts, starts[:, None] + np.stack([r * np.cos(bearing), r * np.sin(bearing)], -1)


def _lattice(starts: Array, ends: Array) -> tuple[Array, tuple[int, int]]:
    """Lattice index ``(2,)`` of the first cell and ``(rows, columns)`` that hold all rays, given in cells."""
    reached = ends[np.isfinite(ends[..., 0])]
    points = np.concatenate([starts, reached])
    first, last = np.floor(points.min(axis=0)), np.floor(points.max(axis=0))
    columns, rows = last - first + 1.0
    if rows * columns > MAX_CELLS:
        raise ValueError(
            f"drawing: a grid of {rows:.0f} x {columns:.0f} cells is too large, at most {MAX_CELLS:,}"
        )
    return first, (int(rows), int(columns))
