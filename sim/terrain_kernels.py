"""Kernels for rays over a height field: heights, normals, and where exactly a ray meets the ground."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.lib.stride_tricks import sliding_window_view

from slam.se2 import Array

BLOCK = 16
"""Cells of the terrain along the side of a block."""


class HeightField(NamedTuple):
    """What the kernels read: node ``heights (rows, columns)``, origin, resolution, highest node [m]."""

    heights: Array
    x0: float
    y0: float
    resolution: float
    highest: float

    def nodes(self) -> tuple[Array, Array]:
        """x and y of every node, each ``(rows, columns)`` m."""
        rows, columns = self.heights.shape
        x = self.x0 + self.resolution * np.arange(columns)
        y = self.y0 + self.resolution * np.arange(rows)
        columns_x, rows_y = np.meshgrid(x, y)
        return columns_x, rows_y


class Ground(NamedTuple):
    """The ground as the ray caster wants it: blocks of it that a ray passes over are skipped at once.

    A height field, the highest node of each block ``tops (rows, columns)`` m, and the lowest of all.

    ``is_level`` where there is nothing but level ground at height 0.
    """

    field: HeightField
    tops: Array
    lowest: float
    is_level: bool


def build_ground(field: HeightField) -> Ground:
    """The height field with the blocks over it."""
    rows, columns = (-(-(n - 1) // BLOCK) for n in field.heights.shape)
    nodes = np.pad(field.heights, ((0, rows * BLOCK + 1), (0, columns * BLOCK + 1)), mode="edge")
    lowest = min(0.0, float(field.heights.min()))
    blocks = sliding_window_view(nodes, (BLOCK + 1, BLOCK + 1))[
        : rows * BLOCK : BLOCK, : columns * BLOCK : BLOCK
    ]
    tops = np.maximum(
        blocks.max(axis=(2, 3)), 0.0
    )  # the last blocks reach beyond the field, where it is level
    return Ground(field, tops, lowest, field.highest == 0.0 == lowest)


@njit(cache=True, error_model="numpy")
def beam_directions(pose, c, s):
    """Unit vectors ``(3, B)`` in the world of beams of a sensor at ``pose (6,)``, from cosines and sines
    ``(B,)`` of their angles.

    ``pose`` is x, y, yaw, roll, pitch, z; R = Rz(yaw) Ry(pitch) Rx(roll).
    """
    sin_yaw, cos_yaw = np.sin(pose[2]), np.cos(pose[2])
    sin_roll, cos_roll = np.sin(pose[3]), np.cos(pose[3])
    sin_pitch, cos_pitch = np.sin(pose[4]), np.cos(pose[4])
    out = np.empty((3, len(c)))
    for b in range(len(c)):
        forward, left = cos_pitch * c[b] + sin_pitch * sin_roll * s[b], cos_roll * s[b]
        out[0, b] = cos_yaw * forward - sin_yaw * left
        out[1, b] = sin_yaw * forward + cos_yaw * left
        out[2, b] = -sin_pitch * c[b] + cos_pitch * sin_roll * s[b]
    return out


@njit(cache=True, error_model="numpy")
def clip_to(o, d, lo, hi, enter, leave):
    """Narrow the stretch [enter, leave] of a ray to where one coordinate lies within [lo, hi]."""
    if d == 0.0:
        if not lo <= o <= hi:
            leave = -np.inf
    else:
        t0, t1 = (lo - o) / d, (hi - o) / d
        enter, leave = max(enter, min(t0, t1)), min(leave, max(t0, t1))
    return enter, leave


@njit(cache=True, error_model="numpy")
def heights_at(points, field):
    """Bilinear heights ``(M,)`` m at ``points (M, 2)``; 0 outside the grid."""
    out = np.empty(len(points))
    for k in range(len(points)):
        out[k] = height_at(points[k, 0], points[k, 1], field)
    return out


@njit(cache=True, error_model="numpy")
def height_at(x, y, field):
    """Bilinear height [m] at one point; 0 outside the grid."""
    rows, columns = field.heights.shape
    fx, fy = (x - field.x0) / field.resolution, (y - field.y0) / field.resolution
    if not (0.0 <= fx <= columns - 1 and 0.0 <= fy <= rows - 1):
        return 0.0
    i, j = min(int(fx), columns - 2), min(int(fy), rows - 2)
    fx, fy = fx - i, fy - j
    h = field.heights
    low = h[j, i] + fx * (h[j, i + 1] - h[j, i])
    high = h[j + 1, i] + fx * (h[j + 1, i + 1] - h[j + 1, i])
    return low + fy * (high - low)


@njit(cache=True, error_model="numpy")
def footprint_plane(x, y, yaw, length, width, field):
    """Height and slopes (forward, left) of the ground under a rectangle, from a 3 × 3 sampling of it."""
    c, s = np.cos(yaw), np.sin(yaw)
    height, forward, left = 0.0, 0.0, 0.0
    for i in range(-1, 2):
        for j in range(-1, 2):
            u, v = 0.5 * i * length, 0.5 * j * width
            h = height_at(x + c * u - s * v, y + s * u + c * v, field)
            height += h / 9.0
            forward += i * h / (3.0 * length)
            left += j * h / (3.0 * width)
    return height, forward, left


@njit(cache=True, error_model="numpy")
def _first_root(a, b, c, end):
    """Smallest t in [0, end] where a t² + b t + c falls to 0, given c > 0; inf when there is none."""
    discriminant = b * b - 4.0 * a * c
    if discriminant < 0.0:
        return np.inf
    q = -0.5 * (b + np.copysign(np.sqrt(discriminant), b))
    first, second = np.inf, np.inf
    if q != 0.0:
        first = c / q
    if a != 0.0:
        second = q / a
    root = np.inf
    if 0.0 <= first <= end:
        root = first
    if 0.0 <= second <= end:
        root = min(root, second)
    return root


@njit(cache=True, error_model="numpy")
def _hit_in_cell(x, y, z, dx, dy, dz, i, j, span, field):
    """Distance from a point of a ray to the ground inside cell (i, j), where the ray stays for ``span``."""
    h = field.heights
    h00, h10, h01, h11 = h[j, i], h[j, i + 1], h[j + 1, i], h[j + 1, i + 1]
    if min(z, z + dz * span) > max(max(h00, h10), max(h01, h11)):
        return np.inf
    res = field.resolution
    fx, fy = (x - field.x0) / res - i, (y - field.y0) / res - j
    gx, gy = dx / res, dy / res
    p, q, w = h10 - h00, h01 - h00, h11 - h10 - h01 + h00
    c = z - (h00 + p * fx + q * fy + w * fx * fy)
    if c <= 0.0:
        return 0.0
    b = dz - (p * gx + q * gy + w * (fx * gy + fy * gx))
    a = -w * gx * gy
    root = _first_root(a, b, c, span)
    if root == np.inf and (a * span + b) * span + c <= 0.0:
        return span
    return root


@njit(cache=True, error_model="numpy")
def _hit_level(z, dz, enter, leave):
    """Hit of the level ground at height 0 between two distances."""
    if enter > leave:
        return np.inf
    if z + dz * enter <= 0.0:
        return enter
    if dz < 0.0 and -z / dz <= leave:
        return -z / dz
    return np.inf


@njit(cache=True, error_model="numpy")
def _below_highest(z, dz, reach, field):
    """From where to where a ray, as long as ``reach``, is not above the highest ground."""
    if dz < 0.0:
        return max(0.0, (field.highest - z) / dz), reach
    if dz > 0.0:
        return 0.0, min(reach, (field.highest - z) / dz)
    return 0.0, (reach if z <= field.highest else -np.inf)


@njit(cache=True, error_model="numpy")
def next_cell(x, y, dx, dy, i, j, x0, y0, size):
    """Distance at which a ray leaves cell (i, j) of a grid, and the cell it comes to."""
    to_x = (x0 + (i + (dx > 0.0)) * size - x) / dx if dx != 0.0 else np.inf
    to_y = (y0 + (j + (dy > 0.0)) * size - y) / dy if dy != 0.0 else np.inf
    if to_x <= to_y:
        return to_x, i + (1 if dx > 0.0 else -1), j
    return to_y, i, j + (1 if dy > 0.0 else -1)


@njit(cache=True, error_model="numpy")
def ground_hit(x, y, z, dx, dy, dz, reach, field):
    """Distance along a ray to the ground, inf when it is not met within ``reach``.

    The ray is point + r · direction. Cell by cell the ground is bilinear, hence quadratic along the ray: its
    first root is the hit, so nothing thinner than a marching step is missed.
    """
    start, stop = _below_highest(z, dz, reach, field)
    if start > stop:
        return np.inf
    rows, columns = field.heights.shape
    res = field.resolution
    enter, leave = clip_to(x, dx, field.x0, field.x0 + (columns - 1) * res, start, stop)
    enter, leave = clip_to(y, dy, field.y0, field.y0 + (rows - 1) * res, enter, leave)
    if enter > leave:
        return _hit_level(z, dz, start, stop)
    before = _hit_level(z, dz, start, enter) if enter > start else np.inf
    if before < np.inf:
        return before
    hit = _walk_cells(x, y, z, dx, dy, dz, enter, leave, field)
    if hit < np.inf or leave >= stop:
        return hit
    return _hit_level(z, dz, leave, stop)


@njit(cache=True, error_model="numpy")
def _walk_cells(x, y, z, dx, dy, dz, enter, leave, field):
    rows, columns = field.heights.shape
    res = field.resolution
    i = min(max(int((x + dx * enter - field.x0) / res), 0), columns - 2)
    j = min(max(int((y + dy * enter - field.y0) / res), 0), rows - 2)
    r = enter
    while 0 <= i < columns - 1 and 0 <= j < rows - 1:
        border, next_i, next_j = next_cell(x, y, dx, dy, i, j, field.x0, field.y0, res)
        end = max(r, min(border, leave))
        hit = _hit_in_cell(x + dx * r, y + dy * r, z + dz * r, dx, dy, dz, i, j, end - r, field)
        if hit < np.inf:
            return r + hit
        if end >= leave:
            return np.inf
        r, i, j = end, next_i, next_j
    return np.inf


@njit(cache=True, error_model="numpy")
def ground_normal(x, y, field):
    """Unit normal (3) of the ground, upwards, by central differences over a thousandth of a cell."""
    e = 1e-3 * field.resolution
    gx = (height_at(x + e, y, field) - height_at(x - e, y, field)) / (2.0 * e)
    gy = (height_at(x, y + e, field) - height_at(x, y - e, field)) / (2.0 * e)
    n = 1.0 / np.sqrt(1.0 + gx * gx + gy * gy)
    return -gx * n, -gy * n, n


@njit(cache=True, error_model="numpy")
def ground_range(x, y, z, dx, dy, dz, reach, ground):
    """Distance along a ray to the ground, inf when it is not met within ``reach``, as `ground_hit`."""
    field, tops = ground.field, ground.tops
    rows, columns = tops.shape
    start, stop = _below_highest(z, dz, reach, field)
    size = field.resolution * BLOCK
    enter, leave = clip_to(x, dx, field.x0, field.x0 + columns * size, start, stop)
    enter, leave = clip_to(y, dy, field.y0, field.y0 + rows * size, enter, leave)
    i = min(max(int((x + dx * enter - field.x0) / size), 0), columns - 1)
    j = min(max(int((y + dy * enter - field.y0) / size), 0), rows - 1)
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
            border, i, j = next_cell(x, y, dx, dy, i, j, field.x0, field.y0, size)
            end = max(r, min(border, leave))
    return np.inf
