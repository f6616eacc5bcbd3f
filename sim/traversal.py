"""Kernels of the ray caster: a uniform grid over the obstacles, walked cell by cell along each ray.

A ray is point + r · direction in three dimensions with a unit direction, so r is the slant range and a ray
straight down needs no special case. Every candidate hit of an obstacle lies beyond the point where the ray
enters its footprint, hence the walk may end in the first cell that ends beyond the best hit.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from sim.terrain import HeightField, ground_hit, ground_normal
from sim.world import Obstacles

MARGIN = 1e-6
"""Cells claim obstacles this close to them [m], so that rounding on a cell border loses none."""


class Grid(NamedTuple):
    """Obstacle indices by cell: ``items[first[c]:first[c+1]]`` for cell c = j · columns + i."""

    x0: float
    y0: float
    cell: float
    columns: int
    rows: int
    first: np.ndarray
    items: np.ndarray


class Scene(NamedTuple):
    """All a ray can hit. ``has_ground`` is False in a planar world, which has neither floor nor ceiling."""

    obstacles: Obstacles
    grid: Grid
    ground: HeightField
    has_ground: bool
    ceiling: float


def build_grid(obstacles: Obstacles, cells_per_obstacle: float = 8.0, longest_side: int = 1024) -> Grid:
    """Grid over the obstacles, with about ``cells_per_obstacle`` cells for each."""
    if len(obstacles.z_lo) == 0:
        return Grid(0.0, 0.0, 1.0, 1, 1, np.zeros(2, dtype=np.int64), np.zeros(0, dtype=np.int64))
    points = obstacles.edges.reshape(-1, 2)
    lower, upper = points.min(axis=0) - MARGIN, points.max(axis=0) + MARGIN
    size = upper - lower
    cell = float(np.sqrt(size[0] * size[1] / (cells_per_obstacle * len(obstacles.z_lo))))
    cell = max(cell, float(size.max()) / longest_side)
    columns, rows = int(size[0] / cell) + 1, int(size[1] / cell) + 1
    first, items = _fill(obstacles, lower[0], lower[1], cell, columns, rows)
    return Grid(float(lower[0]), float(lower[1]), cell, columns, rows, first, items)


@njit(cache=True, error_model="numpy")
def _touches(obstacles, k, x_lo, y_lo, x_hi, y_hi):
    """True where the footprint's lines do not separate it from a box (its bounding box already overlaps)."""
    first, last = obstacles.first[k], obstacles.first[k + 1]
    for e in range(first, last):
        nx, ny, c = obstacles.planes[e, 0], obstacles.planes[e, 1], obstacles.planes[e, 2]
        nearest = min(nx * x_lo, nx * x_hi) + min(ny * y_lo, ny * y_hi)
        if nearest > c:
            return False
        if last - first == 1 and max(nx * x_lo, nx * x_hi) + max(ny * y_lo, ny * y_hi) < c:
            return False
    return True


@njit(cache=True, error_model="numpy")
def _cells_of(obstacles, k, x0, y0, cell, columns, rows):
    """First and last column and row that the bounding box of obstacle k touches."""
    x_lo, y_lo, x_hi, y_hi = np.inf, np.inf, -np.inf, -np.inf
    for e in range(obstacles.first[k], obstacles.first[k + 1]):
        for q in (0, 2):
            x_lo, x_hi = min(x_lo, obstacles.edges[e, q]), max(x_hi, obstacles.edges[e, q])
            y_lo, y_hi = min(y_lo, obstacles.edges[e, q + 1]), max(y_hi, obstacles.edges[e, q + 1])
    i_lo = min(max(int((x_lo - MARGIN - x0) / cell), 0), columns - 1)
    j_lo = min(max(int((y_lo - MARGIN - y0) / cell), 0), rows - 1)
    i_hi = min(max(int((x_hi + MARGIN - x0) / cell), 0), columns - 1)
    j_hi = min(max(int((y_hi + MARGIN - y0) / cell), 0), rows - 1)
    return i_lo, j_lo, i_hi, j_hi


@njit(cache=True, error_model="numpy")
def _fill(obstacles, x0, y0, cell, columns, rows):
    first = np.zeros(columns * rows + 1, dtype=np.int64)
    items = np.zeros(0, dtype=np.int64)
    for storing in (False, True):
        if storing:
            for c in range(columns * rows):
                first[c + 1] += first[c]
            items = np.zeros(first[-1], dtype=np.int64)
        filled = first.copy()
        for k in range(len(obstacles.z_lo)):
            i_lo, j_lo, i_hi, j_hi = _cells_of(obstacles, k, x0, y0, cell, columns, rows)
            for j in range(j_lo, j_hi + 1):
                for i in range(i_lo, i_hi + 1):
                    x, y = x0 + i * cell, y0 + j * cell
                    if _touches(obstacles, k, x - MARGIN, y - MARGIN, x + cell + MARGIN, y + cell + MARGIN):
                        c = j * columns + i
                        if storing:
                            items[filled[c]] = k
                            filled[c] += 1
                        else:
                            first[c + 1] += 1
    return first, items


@njit(cache=True, error_model="numpy")
def _plate_chord(ox, oy, dx, dy, x1, y1, x2, y2):
    """Where a ray meets a segment (entry = exit), or inf; a ray within its line meets its nearer end."""
    ax, ay = x1 - ox, y1 - oy
    ex, ey = x2 - x1, y2 - y1
    crossing = dx * ey - dy * ex
    if crossing != 0.0:
        r = (ax * ey - ay * ex) / crossing
        t = (ax * dy - ay * dx) / crossing
        return r if r >= 0.0 and 0.0 <= t <= 1.0 else np.inf
    horizontal = dx * dx + dy * dy
    if ax * dy - ay * dx != 0.0 or horizontal == 0.0:
        return np.inf
    near = (ax * dx + ay * dy) / horizontal
    far = ((ax + ex) * dx + (ay + ey) * dy) / horizontal
    if max(near, far) < 0.0:
        return np.inf
    return max(0.0, min(near, far))


@njit(cache=True, error_model="numpy")
def _chord(ox, oy, dx, dy, first, last, edges, planes):
    """Entry and exit distance of a ray in a footprint and the edge it enters by; entry is inf for a miss."""
    if last - first == 1:
        r = _plate_chord(ox, oy, dx, dy, edges[first, 0], edges[first, 1], edges[first, 2], edges[first, 3])
        return r, r, first
    r_in, r_out, side = 0.0, np.inf, -1
    for e in range(first, last):
        nx, ny = planes[e, 0], planes[e, 1]
        gap = planes[e, 2] - nx * ox - ny * oy
        speed = nx * dx + ny * dy
        if speed < 0.0:
            r = gap / speed
            if r > r_in:
                r_in, side = r, e
        elif speed > 0.0:
            r_out = min(r_out, gap / speed)
        elif gap < 0.0:
            return np.inf, np.inf, -1
        if r_in > r_out:
            return np.inf, np.inf, -1
    return r_in, r_out, side


@njit(cache=True, error_model="numpy")
def _solid_hit(r_in, r_out, oz, dz, z_lo, z_hi):
    """Hit of a solid on a chord: its front, its top or its underside, whose normal is upright."""
    z_in = oz + dz * r_in
    if z_lo <= z_in <= z_hi:
        return r_in, False
    z_out = oz + dz * r_out
    if z_in > z_hi and z_out < z_hi:
        return (z_hi - oz) / dz, True
    if z_in < z_lo and z_out > z_lo:
        return (z_lo - oz) / dz, True
    return np.inf, False


@njit(cache=True, error_model="numpy")
def _walk_grid(ox, oy, oz, dx, dy, dz, reach, scene):
    """Nearest obstacle hit along a ray and the cosine of its incidence."""
    grid, obstacles = scene.grid, scene.obstacles
    starts, edges, planes = obstacles.first, obstacles.edges, obstacles.planes
    z_lo, z_hi, cells, items = obstacles.z_lo, obstacles.z_hi, grid.first, grid.items
    enter, leave = 0.0, reach
    for o, d, lo, n in ((ox, dx, grid.x0, grid.columns), (oy, dy, grid.y0, grid.rows)):
        hi = lo + n * grid.cell
        if d == 0.0:
            if not lo <= o <= hi:
                return np.inf, 1.0
        else:
            t0, t1 = (lo - o) / d, (hi - o) / d
            enter, leave = max(enter, min(t0, t1)), min(leave, max(t0, t1))
    if enter > leave:
        return np.inf, 1.0
    i = min(max(int((ox + dx * enter - grid.x0) / grid.cell), 0), grid.columns - 1)
    j = min(max(int((oy + dy * enter - grid.y0) / grid.cell), 0), grid.rows - 1)
    step_i, step_j = (1 if dx > 0.0 else -1), (1 if dy > 0.0 else -1)
    next_x = (grid.x0 + (i + (step_i > 0)) * grid.cell - ox) / dx if dx != 0.0 else np.inf
    next_y = (grid.y0 + (j + (step_j > 0)) * grid.cell - oy) / dy if dy != 0.0 else np.inf
    stride_x = grid.cell / abs(dx) if dx != 0.0 else np.inf
    stride_y = grid.cell / abs(dy) if dy != 0.0 else np.inf
    best, cosine = np.inf, 1.0
    while True:
        c = j * grid.columns + i
        for item in range(cells[c], cells[c + 1]):
            k = items[item]
            r_in, r_out, side = _chord(ox, oy, dx, dy, starts[k], starts[k + 1], edges, planes)
            if r_in >= best:
                continue
            r, upright = _solid_hit(r_in, r_out, oz, dz, z_lo[k], z_hi[k])
            if r < best:
                best = r
                if upright or side < 0:
                    cosine = abs(dz) if upright else 1.0
                else:
                    cosine = abs(planes[side, 0] * dx + planes[side, 1] * dy)
        end = min(next_x, next_y)
        if best <= end or end >= leave:
            break
        if next_x <= next_y:
            i += step_i
            next_x += stride_x
        else:
            j += step_j
            next_y += stride_y
        if not (0 <= i < grid.columns and 0 <= j < grid.rows):
            break
    return best, cosine


@njit(cache=True, error_model="numpy")
def cast_ray(ox, oy, oz, dx, dy, dz, reach, scene):
    """Slant range [m] to the first thing a ray meets within ``reach`` (else inf), and cos(incidence)."""
    best, cosine = _walk_grid(ox, oy, oz, dx, dy, dz, reach, scene)
    if scene.has_ground:
        r = ground_hit(ox, oy, oz, dx, dy, dz, min(best, reach), scene.ground)
        if r < best:
            nx, ny, nz = ground_normal(ox + dx * r, oy + dy * r, scene.ground)
            best, cosine = r, abs(nx * dx + ny * dy + nz * dz)
        if dz > 0.0:
            r = max(0.0, (scene.ceiling - oz) / dz)
            if r < best:
                best, cosine = r, dz
    if best > reach:
        best = np.inf
    return best, cosine


@njit(cache=True, error_model="numpy")
def cast_beams(poses, angles, reach, scene, ranges, cosines):
    """Cast every beam (B) of every pose (N, 6); writes ranges (N, B), NaN for nothing, and cosines (N, B)."""
    for n in range(len(poses)):
        x, y, yaw, roll, pitch, z = poses[n]
        sin_roll, cos_roll, sin_pitch, cos_pitch = np.sin(roll), np.cos(roll), np.sin(pitch), np.cos(pitch)
        sin_yaw, cos_yaw = np.sin(yaw), np.cos(yaw)
        for b in range(len(angles)):
            c, s = np.cos(angles[b]), np.sin(angles[b])
            bx = cos_pitch * c + sin_pitch * sin_roll * s
            by = cos_roll * s
            bz = -sin_pitch * c + cos_pitch * sin_roll * s
            dx, dy = cos_yaw * bx - sin_yaw * by, sin_yaw * bx + cos_yaw * by
            r, cosine = cast_ray(x, y, z, dx, dy, bz, reach, scene)
            ranges[n, b] = r if r < np.inf else np.nan
            cosines[n, b] = cosine
