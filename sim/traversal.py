"""Kernels of the ray caster. All rays of one pose go together: a fan.

A ray is point + r · direction in three dimensions with a unit direction, so r is the slant range and a ray
straight down needs no special case. What it can meet are upright plates (the edges of the obstacles, each
with its band of heights), level caps (tops and undersides of solids), the ground and the ceiling.

First every ray is tested against the shapes around the pose, one shape at a time: a loop over contiguous
arrays, which the compiler turns into vector instructions. Rays that leave this region without a hit then
walk the grid on their own, box by box, until the best hit lies before the end of the box.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from sim.cells import Cells
from sim.terrain_kernels import Ground, beam_directions, clip_to, ground_normal, ground_range
from sim.world import Obstacles

NUDGE = 1e-7
"""Rays step this far over the border of a box [cells], less than the margin of the cells' claims."""
ON_LINE = 1e-9
"""A plate that spans twice this area with the sensor [m²] is seen edge on, and treated with care."""
RIM = 1e-12
"""Caps reach this far beyond their edges [m], so that rounding lets no ray in between cap and plate."""
HUGE = 1e300
"""Instead of the infinite distance that a ray along one axis needs to a border across the other [m]."""
NOTHING, LEVEL, GROUND, INSIDE = -1, -2, -3, -4
"""What a ray met, where it is not the plate of that number. Level: a cap, the ceiling."""


class Scene(NamedTuple):
    """All a ray can meet. ``has_ground`` is False in a world with neither floor nor ceiling."""

    obstacles: Obstacles
    cells: Cells
    ground: Ground
    has_ground: bool
    ceiling: float


@njit(cache=True, error_model="numpy")
def plate_range(ax, ay, bx, by, dx, dy):
    """Where a ray from the origin meets a segment, or inf; a ray within its line meets its nearer end.

    The segment is met when its ends lie on both sides of the ray. Segments that share an end agree on its
    side, so that no ray slips through a corner (Woop et al. 2013, Watertight ray/triangle intersection).
    """
    side_a, side_b = ax * dy - ay * dx, bx * dy - by * dx
    if side_a * side_b > 0.0:
        return np.inf
    along = dx * dx + dy * dy
    if side_a != side_b:
        share = side_a / (side_a - side_b)
        r = (ax * dx + ay * dy + share * ((bx - ax) * dx + (by - ay) * dy)) / along
        return r if r >= 0.0 else np.inf
    if along == 0.0:
        return np.inf
    near, far = (ax * dx + ay * dy) / along, (bx * dx + by * dy) / along
    return max(0.0, min(near, far)) if max(near, far) >= 0.0 else np.inf


@njit(cache=True, error_model="numpy")
def _cap_range(x, y, z, dx, dy, dz, k, nearest, obstacles):
    """Where a ray meets the top or the underside of solid k before ``nearest``, or inf."""
    if dz == 0.0:
        return np.inf
    r = ((obstacles.z_hi[k] if dz < 0.0 else obstacles.z_lo[k]) - z) / dz
    if not 0.0 <= r < nearest:
        return np.inf
    return r if _is_within(x + dx * r, y + dy * r, k, RIM, obstacles) else np.inf


@njit(cache=True, error_model="numpy")
def _is_within(x, y, k, margin, obstacles):
    """True where the footprint of solid k, and a margin, contains a point."""
    for e in range(obstacles.first[k], obstacles.first[k + 1]):
        if obstacles.planes[e, 0] * x + obstacles.planes[e, 1] * y > obstacles.planes[e, 2] + margin:
            return False
    return True


@njit(cache=True, error_model="numpy")
def _is_inside_solid(x, y, z, c, planar, scene):
    """True where a point of cell c lies inside a solid."""
    cells, obstacles = scene.cells, scene.obstacles
    for n in range(cells.leaps[c, 5], cells.leaps[c, 6]):
        k = cells.shapes[n] - len(obstacles.edges)
        if (planar or obstacles.z_lo[k] <= z <= obstacles.z_hi[k]) and _is_within(x, y, k, 0.0, obstacles):
            return True
    return False


@njit(cache=True, error_model="numpy")
def _look_around(x, y, z, c, dx, dy, dz, planar, scene, nearest, hit, seen):
    """Test rays from cell c against the shapes of the region around it, up to where each leaves it."""
    cells, obstacles = scene.cells, scene.obstacles
    for n in range(cells.regions[c, 4]):
        e = cells.region_shapes[c, n]
        if e < len(cells.plates):
            ax, ay, bx, by = cells.plates[e, :4] - np.array([x, y, x, y])
            z_lo, z_hi = (-np.inf, np.inf) if planar else (cells.plates[e, 4] - z, cells.plates[e, 5] - z)
            _meet_plate(e, ax, ay, bx, by, z_lo, z_hi, dx, dy, dz, nearest, hit)
        elif not planar:
            for b in range(len(dx)):
                r = _cap_range(x, y, z, dx[b], dy[b], dz[b], e - len(cells.plates), nearest[b], obstacles)
                if r < np.inf:
                    nearest[b], hit[b] = r, LEVEL
    if cells.regions[c, 4] >= 0:
        i_lo, i_hi, j_lo, j_hi, _ = cells.regions[c]
        x_lo, x_hi = cells.x0 + cells.size * i_lo - x, cells.x0 + cells.size * i_hi - x
        y_lo, y_hi = cells.y0 + cells.size * j_lo - y, cells.y0 + cells.size * j_hi - y
        for b in range(len(dx)):
            to_x, to_y = (x_hi if dx[b] > 0.0 else x_lo) / dx[b], (y_hi if dy[b] > 0.0 else y_lo) / dy[b]
            seen[b] = min(to_x if dx[b] != 0.0 else np.inf, to_y if dy[b] != 0.0 else np.inf)


@njit(cache=True, error_model="numpy")
def _meet_plate(e, ax, ay, bx, by, z_lo, z_hi, dx, dy, dz, nearest, hit):
    """Test rays against plate e; its ends and heights are relative to the sensor."""
    area = ax * (by - ay) - ay * (bx - ax)
    if abs(area) < ON_LINE:
        for b in range(len(dx)):
            r = plate_range(ax, ay, bx, by, dx[b], dy[b])
            if r < nearest[b] and z_lo <= dz[b] * r <= z_hi:
                nearest[b], hit[b] = r, e
        return
    for b in range(len(dx)):
        side_a, side_b = ax * dy[b] - ay * dx[b], bx * dy[b] - by * dx[b]
        r = area / (side_a - side_b)
        z = dz[b] * r
        met = (side_a * side_b <= 0.0) & (r >= 0.0) & (r < nearest[b]) & (z >= z_lo) & (z <= z_hi)
        nearest[b] = r if met else nearest[b]
        hit[b] = e if met else hit[b]


@njit(cache=True, error_model="numpy")
def _walk(x, y, z, directions, reach, planar, scene, nearest, hit, seen):
    """Follow every ray that has not met anything in what it has seen, box by box."""
    cells, obstacles = scene.cells, scene.obstacles
    leaps, copies, shapes, edge_count = cells.leaps, cells.copies, cells.shapes, len(obstacles.edges)
    columns, rows, size, scale = cells.columns, cells.rows, cells.size, 1.0 / cells.size
    gx, gy = (x - cells.x0) * scale, (y - cells.y0) * scale
    for b in range(len(nearest)):
        dx, dy, dz, best, what = directions[0, b], directions[1, b], directions[2, b], nearest[b], hit[b]
        far = seen[b]
        if min(best, reach) <= far:
            continue
        per_x = size / dx if dx != 0.0 else HUGE
        per_y = size / dy if dy != 0.0 else HUGE
        kx, ky = dx * scale, dy * scale
        side_x, side_y = (1 if dx >= 0.0 else 0), (3 if dy >= 0.0 else 2)
        at_x, at_y = gx + (NUDGE if dx >= 0.0 else -NUDGE), gy + (NUDGE if dy >= 0.0 else -NUDGE)
        while min(best, reach) > far:
            i, j = int(at_x + far * kx), int(at_y + far * ky)
            if i < 1 or j < 1 or i >= columns - 1 or j >= rows - 1:
                break
            c = j * columns + i
            for n in range(leaps[c, 4], leaps[c, 5]):
                ax, ay, bx, by = copies[n, 0] - x, copies[n, 1] - y, copies[n, 2] - x, copies[n, 3] - y
                r = plate_range(ax, ay, bx, by, dx, dy)
                if r < best and (planar or copies[n, 4] <= z + dz * r <= copies[n, 5]):
                    best, what = r, shapes[n]
            if not planar:
                for n in range(leaps[c, 5], leaps[c, 6]):
                    r = _cap_range(x, y, z, dx, dy, dz, shapes[n] - edge_count, best, obstacles)
                    if r < best:
                        best, what = r, LEVEL
            far = min((leaps[c, side_x] - gx) * per_x, (leaps[c, side_y] - gy) * per_y)
        nearest[b], hit[b] = best, what


@njit(cache=True, error_model="numpy")
def _cast_fan(x, y, z, directions, reach, planar, scene, nearest, hit):
    """Distances to the nearest that rays (B) of one point meet, and what it is."""
    tilted = scene.has_ground and not planar
    cells, dx, dy, dz = scene.cells, directions[0], directions[1], directions[2]
    seen = np.zeros(len(dx))
    nearest[:], hit[:] = np.inf, NOTHING
    if tilted:
        for b in range(len(nearest)):
            if dz[b] > 0.0:
                nearest[b], hit[b] = max(0.0, (scene.ceiling - z) / dz[b]), LEVEL
            elif dz[b] < 0.0:  # where it is below all the ground
                nearest[b], hit[b] = max(0.0, (scene.ground.lowest - z) / dz[b]), GROUND
    i, j = math.floor((x - cells.x0) / cells.size), math.floor((y - cells.y0) / cells.size)
    if 1 <= i < cells.columns - 1 and 1 <= j < cells.rows - 1:
        c = j * cells.columns + i
        if _is_inside_solid(x, y, z, c, planar, scene):
            nearest[:], hit[:] = 0.0, INSIDE
            return
        _look_around(x, y, z, c, dx, dy, dz, planar, scene, nearest, hit, seen)
    else:
        x_lo, y_lo = cells.x0 + cells.size, cells.y0 + cells.size
        x_hi, y_hi = cells.x0 + cells.size * (cells.columns - 1), cells.y0 + cells.size * (cells.rows - 1)
        for b in range(len(dx)):
            enter, leave = clip_to(x, dx[b], x_lo, x_hi, 0.0, np.inf)
            enter, leave = clip_to(y, dy[b], y_lo, y_hi, enter, leave)
            seen[b] = enter if enter < leave else np.inf
    _walk(x, y, z, directions, reach, planar, scene, nearest, hit, seen)
    if tilted and not scene.ground.is_level:
        for b in range(len(nearest)):
            r = ground_range(x, y, z, dx[b], dy[b], dz[b], min(nearest[b], reach), scene.ground)
            if r < nearest[b]:
                nearest[b], hit[b] = r, GROUND


@njit(cache=True, error_model="numpy")
def _incidence(x, y, directions, nearest, hit, scene, cosines):
    """Cosine of the angle between each ray and the normal of what it met; 1 inside a solid or for nothing."""
    planes = scene.obstacles.planes
    for b in range(len(nearest)):
        dx, dy, dz = directions[0, b], directions[1, b], directions[2, b]
        cosines[b] = 1.0
        if hit[b] >= 0:
            cosines[b] = abs(planes[hit[b], 0] * dx + planes[hit[b], 1] * dy)
        elif hit[b] == LEVEL:
            cosines[b] = abs(dz)
        elif hit[b] == GROUND:
            nx, ny, nz = ground_normal(x + dx * nearest[b], y + dy * nearest[b], scene.ground.field)
            cosines[b] = abs(nx * dx + ny * dy + nz * dz)


@njit(cache=True, error_model="numpy")
def cast_beams(poses, c, s, reach, planar, scene, ranges, cosines):
    """Cast beams whose cosines and sines are c and s (B) of every pose (N, 6).

    Writes ranges (N, B), NaN for nothing, and cosines of the incidence where ``cosines`` is (N, B) too,
    rather than empty. ``planar``: only x, y and yaw count, every obstacle is endlessly high, and there is
    neither floor nor ceiling.
    """
    hit = np.empty(len(c), dtype=np.int64)
    for n in range(len(poses)):
        x, y, z = poses[n, 0], poses[n, 1], poses[n, 5]
        directions = beam_directions(poses[n], c, s)
        _cast_fan(x, y, z, directions, reach, planar, scene, ranges[n], hit)
        if cosines.size > 0:
            _incidence(x, y, directions, ranges[n], hit, scene, cosines[n])
        for b in range(len(c)):
            if ranges[n, b] > reach or ranges[n, b] == np.inf:
                ranges[n, b] = np.nan
