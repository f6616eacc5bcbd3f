"""A uniform grid over the obstacles, prepared so that a ray needs few steps.

Every cell knows the shapes that touch it and two boxes of cells around it: one that holds no further shape,
which a ray leaps across in one step, and a region with up to `REGION_SHAPES` shapes, which a whole fan of
rays from the cell is tested against at once. A shape is an edge, or the footprint of a solid.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from sim.world import Obstacles
from slam.se2 import Array

MARGIN = 1e-6
"""Cells claim shapes this close to them [cells], so that rounding on a border loses none."""
CELLS_PER_EDGE = 4.0
LONGEST_SIDE = 1024
"""Cells along the longer side of the grid, at most."""
REGION_SHAPES = 12


class Frame(NamedTuple):
    """Where cells lie: cell c = j · columns + i spans ``size`` m from ``(x0, y0) + size · (i, j)``."""

    x0: float
    y0: float
    size: float
    columns: int
    rows: int


class Cells(NamedTuple):
    """The grid, its `Frame` first. Shapes of cell c are ``shapes[a:b]`` (edges) and ``shapes[b:c]`` (solids).

    ``plates (E, 6)``: x1, y1, x2, y2, z_lo, z_hi m of each edge; ``copies``: the same in the order of
    ``shapes``. ``leaps (cells, 7)`` int32: the box i_lo, i_hi, j_lo, j_hi (ends excluded), a, b, c.
    ``regions (cells, 5)``: the box and the number of its shapes, -1 where the cell alone has too many, listed
    in ``region_shapes (cells, REGION_SHAPES)``. The outermost ring of cells is empty and belongs to no box.
    """

    x0: float
    y0: float
    size: float
    columns: int
    rows: int
    plates: Array
    shapes: np.ndarray
    copies: Array
    leaps: np.ndarray
    regions: np.ndarray
    region_shapes: np.ndarray


def build(obstacles: Obstacles) -> Cells:
    """The grid over some obstacles. Edge e is shape e; solid k is shape (number of edges) + k."""
    edges, counts = obstacles.edges, np.diff(obstacles.first)
    frame = _frame(edges)
    single, begin, end = np.arange(len(edges)), obstacles.first[:-1], obstacles.first[1:]
    first = np.concatenate([single, begin])  # edges of every shape; a plate is no solid, hence empty as one
    last = np.concatenate([single + 1, np.where(counts > 1, end, begin)])
    filled = np.zeros(frame.columns * frame.rows, dtype=np.int64)
    _sort(first, last, edges, obstacles.planes, frame, filled, np.empty(0, dtype=np.int32))
    starts = np.concatenate([[0], np.cumsum(filled)])  # shapes[starts[c]:starts[c + 1]] touch cell c
    shapes = np.empty(starts[-1], dtype=np.int32)
    _sort(first, last, edges, obstacles.planes, frame, starts[:-1].copy(), shapes)
    bands = np.column_stack([obstacles.z_lo, obstacles.z_hi]).repeat(counts, axis=0)
    plates = np.hstack([edges, bands])
    before = np.concatenate([[0], np.cumsum(shapes < len(edges))])
    solids_at = starts[:-1] + np.diff(before[starts])
    limits = np.diff(starts)
    leaps, _ = _grow_all(limits, starts, shapes, frame, 0)
    few = np.full_like(limits, REGION_SHAPES)
    regions, region_shapes = _grow_all(few, starts, shapes, frame, REGION_SHAPES)
    return Cells(
        *frame,
        plates=plates,
        shapes=shapes,
        copies=plates[np.where(shapes < len(edges), shapes, 0)],
        leaps=np.column_stack([leaps[:, :4], starts[:-1], solids_at, starts[1:]]).astype(np.int32),
        regions=regions,
        region_shapes=region_shapes,
    )


def _frame(edges: Array) -> Frame:
    """Where the cells lie: over all edges, with a ring to spare."""
    points = edges.reshape(-1, 2) if len(edges) else np.zeros((1, 2))
    lower = points.min(axis=0)
    extent = points.max(axis=0) - lower
    size = float(np.sqrt(extent.prod() / (CELLS_PER_EDGE * max(1, len(edges)))))
    size = max(size, float(extent.max()) / LONGEST_SIDE) or 1.0
    columns, rows = (int(n) for n in extent / size + 1.0)
    x0, y0 = (float(v) for v in lower - 1.01 * size)
    return Frame(x0, y0, size, columns + 3, rows + 3)


@njit(cache=True, error_model="numpy")
def _touches(first, last, edges, planes, x_lo, y_lo, x_hi, y_hi):
    """True where a shape's lines do not separate it from a box (its bounding box already overlaps)."""
    for e in range(first, last):
        nx, ny, c = planes[e, 0], planes[e, 1], planes[e, 2]
        if min(nx * x_lo, nx * x_hi) + min(ny * y_lo, ny * y_hi) > c:
            return False
        if last - first == 1 and max(nx * x_lo, nx * x_hi) + max(ny * y_lo, ny * y_hi) < c:
            return False
    return True


@njit(cache=True, error_model="numpy")
def _bounds(first, last, edges, frame):
    """First and last column and row that the bounding box of a shape touches; none for an empty shape."""
    x_lo, y_lo, x_hi, y_hi = np.inf, np.inf, -np.inf, -np.inf
    for e in range(first, last):
        for q in (0, 2):
            x_lo, x_hi = min(x_lo, edges[e, q]), max(x_hi, edges[e, q])
            y_lo, y_hi = min(y_lo, edges[e, q + 1]), max(y_hi, edges[e, q + 1])
    if first == last:
        return 0, 0, -1, -1
    i_lo, i_hi = int((x_lo - frame.x0) / frame.size - MARGIN), int((x_hi - frame.x0) / frame.size + MARGIN)
    j_lo, j_hi = int((y_lo - frame.y0) / frame.size - MARGIN), int((y_hi - frame.y0) / frame.size + MARGIN)
    return i_lo, j_lo, i_hi, j_hi


@njit(cache=True, error_model="numpy")
def _sort(first, last, edges, planes, frame, filled, shapes):
    """Write every shape where its cells are filled to (only count while ``shapes`` is empty)."""
    size, margin = frame.size, MARGIN * frame.size
    for k in range(len(first)):
        i_lo, j_lo, i_hi, j_hi = _bounds(first[k], last[k], edges, frame)
        for j in range(j_lo, j_hi + 1):
            for i in range(i_lo, i_hi + 1):
                x, y = frame.x0 + i * size - margin, frame.y0 + j * size - margin
                far_x, far_y = x + size + 2.0 * margin, y + size + 2.0 * margin
                if _touches(first[k], last[k], edges, planes, x, y, far_x, far_y):
                    c = j * frame.columns + i
                    if len(shapes) > 0:
                        shapes[filled[c]] = k
                    filled[c] += 1


@njit(cache=True)
def _collect(box, columns, starts, shapes, members, count, limit):
    """Add the shapes of a box of cells to ``members``; returns their number, -1 when it passes ``limit``."""
    for j in range(box[2], box[3]):
        for i in range(box[0], box[1]):
            c = j * columns + i
            for n in range(starts[c], starts[c + 1]):
                known = False
                for m in range(count):
                    known = known or members[m] == shapes[n]
                if not known:
                    if count == limit:
                        return -1
                    members[count] = shapes[n]
                    count += 1
    return count


@njit(cache=True)
def _grow(limit, starts, shapes, frame, box, strip, members):
    """Grow a box of one cell, its sides in turn, while it holds at most ``limit`` shapes; their number.

    The number is -1 where the cell alone holds more. ``strip (4,)`` is room to work in.
    """
    count = _collect(box, frame.columns, starts, shapes, members, 0, limit)
    free = 15 if count >= 0 else 0
    side = 0
    while free != 0:
        if free >> side & 1:
            for q in range(4):
                strip[q] = box[q]
            strip[side ^ 1] = box[side]
            strip[side] += 2 * (side % 2) - 1
            grown = -1
            if min(strip[0], strip[2]) >= 1 and strip[1] < frame.columns and strip[3] < frame.rows:
                grown = _collect(strip, frame.columns, starts, shapes, members, count, limit)
            if grown < 0:
                free -= 1 << side
            else:
                count, box[side] = grown, strip[side]
        side = (side + 1) % 4
    return count


@njit(cache=True)
def _grow_all(limits, starts, shapes, frame, listed):
    """For every cell the box grown with its limit, the number of shapes, and the first ``listed`` of them."""
    boxes = np.zeros((len(limits), 5), dtype=np.int32)
    lists = np.zeros((len(limits), listed), dtype=np.int32)
    members, strip = np.zeros(limits.max(), dtype=np.int32), np.zeros(4, dtype=np.int32)
    for j in range(1, frame.rows - 1):
        for i in range(1, frame.columns - 1):
            c = j * frame.columns + i
            boxes[c, 0], boxes[c, 1], boxes[c, 2], boxes[c, 3] = i, i + 1, j, j + 1
            boxes[c, 4] = _grow(limits[c], starts, shapes, frame, boxes[c], strip, members)
            for n in range(min(listed, boxes[c, 4])):
                lists[c, n] = members[n]
    return boxes, lists
