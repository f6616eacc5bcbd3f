"""The ground as a ray caster wants it: blocks of terrain that a ray passes over are skipped at once."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from sim.terrain import HeightField, clip_to, ground_hit
from slam.se2 import Array

BLOCK = 16
"""Cells of the terrain along the side of a block."""


class Ground(NamedTuple):
    """A height field, the highest node of each block ``tops (rows, columns)`` m, and the lowest of all.

    ``is_level`` where there is nothing but level ground at height 0.
    """

    field: HeightField
    tops: Array
    lowest: float
    is_level: bool


def build(field: HeightField) -> Ground:
    """The ground of a terrain."""
    rows, columns = (-(-(n - 1) // BLOCK) for n in field.heights.shape)
    nodes = np.pad(field.heights, ((0, rows * BLOCK + 1), (0, columns * BLOCK + 1)), mode="edge")
    lowest = min(0.0, float(field.heights.min()))
    return Ground(field, _tops(nodes, rows, columns), lowest, field.highest == 0.0 == lowest)


@njit(cache=True)
def _tops(nodes, rows, columns):
    tops = np.empty((rows, columns))
    for j in range(rows):
        for i in range(columns):
            block = nodes[j * BLOCK : (j + 1) * BLOCK + 1, i * BLOCK : (i + 1) * BLOCK + 1]
            tops[j, i] = max(0.0, block.max())  # the last blocks reach beyond the field, where it is level
    return tops


@njit(cache=True, error_model="numpy")
def ground_range(x, y, z, dx, dy, dz, reach, ground):
    """Distance along a ray to the ground, inf when it is not met within ``reach``, as `ground_hit`."""
    field, tops = ground.field, ground.tops
    rows, columns = tops.shape
    start, stop = 0.0, reach
    if dz < 0.0:  # only where the ray is below the highest ground
        start = max(start, (field.highest - z) / dz)
    elif dz > 0.0:
        stop = min(stop, (field.highest - z) / dz)
    elif z > field.highest:
        return np.inf
    size = field.resolution * BLOCK
    enter, leave = clip_to(x, dx, field.x0, field.x0 + columns * size, start, stop)
    enter, leave = clip_to(y, dy, field.y0, field.y0 + rows * size, enter, leave)
    i = min(max(int((x + dx * enter - field.x0) / size), 0), columns - 1)
    j = min(max(int((y + dy * enter - field.y0) / size), 0), rows - 1)
    step_i, step_j = (1 if dx > 0.0 else -1), (1 if dy > 0.0 else -1)
    r, end = start, (enter if enter < leave else stop)
    top = np.inf if end > r else -np.inf  # outside the blocks nothing is skipped
    while r <= end:
        if min(z + dz * r, z + dz * end) <= top:
            hit = ground_hit(x + dx * r, y + dy * r, z + dz * r, dx, dy, dz, end - r, field)
            if hit < np.inf:
                return r + hit
        if end >= stop:
            break
        r, end, top = end, stop, np.inf
        if r < leave and 0 <= i < columns and 0 <= j < rows:
            top = tops[j, i]
            next_x = (field.x0 + (i + (step_i > 0)) * size - x) / dx if dx != 0.0 else np.inf
            next_y = (field.y0 + (j + (step_j > 0)) * size - y) / dy if dy != 0.0 else np.inf
            end = max(r, min(next_x, next_y, leave))
            i, j = (i + step_i, j) if next_x <= next_y else (i, j + step_j)
    return np.inf
