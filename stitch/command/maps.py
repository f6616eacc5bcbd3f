"""A ROS map as a submap."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from slam.formats import FormatError, ros_map
from slam.mapping.occupancy import Grid
from slam.mapping.submap import Submap
from stitch.alignment.config import AlignConfig
from stitch.alignment.walls import surfaces

MIN_WALLS = 10
"""Occupied cells below which there is nothing to align."""
MAX_SEARCH = 25_000_000
"""Cells that a search may have: two maps side by side, turned as they may be."""
BYTES_PER_SEARCH_CELL = 60


def read_submap(path: Path) -> tuple[Submap, tuple[str, ...]]:
    """The map as a submap whose anchor is the image's lower left corner, in the map's frame; and what the
    user should know of it, a line each.

    Cells beyond those that are known are cut off. In a map without unknown cells, as a floor plan is, free
    means not drawn: nothing there was seen, so it neither speaks against a wall nor for an overlap, and only
    the walls are kept. Raises `FormatError` for a map that cannot be read or has hardly any wall.
    """
    found = ros_map.read_map(path)
    grid = found.grid if found.states_unknown else replace(found.grid, free=np.zeros_like(found.grid.free))
    walls = int(grid.occupied.sum())
    if walls < MIN_WALLS:
        height, width = grid.occupied.shape
        message = f"{walls} occupied of {width} x {height} cells, expected at least {MIN_WALLS} to align"
        raise FormatError(message, path)
    known = cropped(grid)
    return Submap(0, 1, found.T_map_grid, surfaces(known), known), found.notes


def settings_for(submaps: Sequence[Submap], method: str = "joint") -> AlignConfig:
    """The settings of a method for some maps; a raster is never finer than the maps are."""
    coarsest = max(submap.grid.resolution for submap in submaps)
    default = AlignConfig()
    return AlignConfig(
        method=method,
        resolution=max(default.resolution, coarsest),
        search=replace(default.search, resolution=max(default.search.resolution, coarsest)),
    )


def check_size(submaps: Sequence[Submap], config: AlignConfig) -> None:
    """See that any two of the maps can be aligned in memory. Raises `FormatError`."""
    sides = np.array([submap.grid.occupied.shape for submap in submaps]) * np.array(
        [[submap.grid.resolution] for submap in submaps]
    )
    longest = np.max(np.hypot(*sides.T))  # of a map turned by any angle
    cells = float(np.max(np.prod((sides + longest) / config.search.resolution, axis=1)))
    if not cells <= MAX_SEARCH:
        need, most = (BYTES_PER_SEARCH_CELL * count / 1e9 for count in (cells, MAX_SEARCH))
        size = ", ".join(f"{width:.0f} x {height:.0f} m" for height, width in sides)
        raise FormatError(
            f"maps of {size}: aligning takes {need:.1f} GB of memory, expected at most {most:.1f}"
        )


def cropped(grid: Grid) -> Grid:
    """The smallest part of a grid that holds all its known cells."""
    known = grid.occupied | grid.free
    (top, bottom), (left, right) = (np.flatnonzero(known.any(axis=axis))[[0, -1]] + (0, 1) for axis in (1, 0))
    part = np.s_[top:bottom, left:right]
    origin = grid.origin + np.array([left, top]) * grid.resolution
    occupied, free = (np.ascontiguousarray(cells[part]) for cells in (grid.occupied, grid.free))
    return Grid(occupied, free, origin, grid.resolution)
