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
from sim.terrain_kernels import Ground, clip_to, ground_normal, ground_range
from sim.world import Obstacles
from slam.se2 import Array

NUDGE = 1e-7
"""Rays step this far over the border of a box [cells], less than the margin of the cells' claims."""
ON_LINE = 1e-9
"""A plate that spans twice this area with the sensor [m²] is seen edge on, and treated with care."""
RIM = 1e-12
"""Caps reach this far beyond their edges [m], so that rounding lets no ray in between cap and plate."""
UPRIGHT = 0.1
"""Seen from above, beams keep their order while the cosine of the sensor's tilt is larger."""
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


class Fan(NamedTuple):
    """Rays (B) of one pose: directions, distance m to the nearest hit so far, what it is, and to which
    distance all there is has been looked at. ``right`` and ``left`` are the outermost rays, ``width`` rad
    apart (infinite where the fan is turned so far over that they need not be).
    """

    right: int
    left: int
    width: float
    dx: Array
    dy: Array
    dz: Array
    nearest: Array
    hit: np.ndarray
    seen: Array


@njit(cache=True)
def _outermost(angles):
    """The beams furthest to the right and to the left, and the angle between them [rad]."""
    right, left = 0, 0
    for b in range(len(angles)):
        right, left = (b if angles[b] < angles[right] else right), (b if angles[b] > angles[left] else left)
    return right, left, (angles[left] - angles[right] if len(angles) > 0 else np.inf)


@njit(cache=True, error_model="numpy")
def _aim(pose, c, s, fan):
    """Directions of beams with these cosines and sines: R = Rz(yaw) Ry(pitch) Rx(roll)."""
    sin_yaw, cos_yaw = np.sin(pose[2]), np.cos(pose[2])
    sin_roll, cos_roll = np.sin(pose[3]), np.cos(pose[3])
    sin_pitch, cos_pitch = np.sin(pose[4]), np.cos(pose[4])
    for b in range(len(c)):
        forward, left = cos_pitch * c[b] + sin_pitch * sin_roll * s[b], cos_roll * s[b]
        fan.dx[b] = cos_yaw * forward - sin_yaw * left
        fan.dy[b] = sin_yaw * forward + cos_yaw * left
        fan.dz[b] = -sin_pitch * c[b] + cos_pitch * sin_roll * s[b]


@njit(cache=True, error_model="numpy")
def _bound(z, scene, planar, fan):
    """Set every ray's nearest hit to the ceiling's, or to where it is below all the ground."""
    for b in range(len(fan.dx)):
        fan.nearest[b], fan.hit[b] = np.inf, NOTHING
    if planar or not scene.has_ground:
        return
    for b in range(len(fan.dx)):
        dz = fan.dz[b]
        if dz > 0.0:
            fan.nearest[b], fan.hit[b] = max(0.0, (scene.ceiling - z) / dz), LEVEL
        elif dz < 0.0:
            fan.nearest[b], fan.hit[b] = max(0.0, (scene.ground.lowest - z) / dz), GROUND


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
def _meet_plate(e, ax, ay, bx, by, z_lo, z_hi, fan):
    """Test a whole fan against plate e; its ends and heights are relative to the sensor."""
    dx, dy, dz, nearest, hit = fan.dx, fan.dy, fan.dz, fan.nearest, fan.hit
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
def _look_around(x, y, z, c, planar, scene, fan):
    """Test a fan from cell c against the shapes of the region around it."""
    cells, obstacles = scene.cells, scene.obstacles
    plates, count = cells.plates, cells.regions[c, 4]
    if count < 0:
        for b in range(len(fan.seen)):
            fan.seen[b] = 0.0
        return
    _see_box(x, y, cells.regions[c], cells, fan)
    for n in range(count):
        e = cells.region_shapes[c, n]
        if e >= len(plates):
            if not planar:
                _meet_caps(x, y, z, e - len(plates), obstacles, fan)
            continue
        ax, ay, bx, by = plates[e, 0] - x, plates[e, 1] - y, plates[e, 2] - x, plates[e, 3] - y
        if _is_behind(ax, ay, bx, by, fan):
            continue
        if cells.closed[e] and ax * (by - ay) - ay * (bx - ax) > ON_LINE:
            continue  # the far side of a solid
        z_lo, z_hi = (-np.inf, np.inf) if planar else (plates[e, 4] - z, plates[e, 5] - z)
        _meet_plate(e, ax, ay, bx, by, z_lo, z_hi, fan)


@njit(cache=True, error_model="numpy")
def _is_behind(ax, ay, bx, by, fan):
    """True where a segment lies in the sector that no ray of the fan looks into."""
    if fan.width >= 2.0 * np.pi:
        return False
    right_x, right_y, left_x, left_y = (
        fan.dx[fan.right],
        fan.dy[fan.right],
        fan.dx[fan.left],
        fan.dy[fan.left],
    )
    a_right, b_right = right_x * ay - right_y * ax < 0.0, right_x * by - right_y * bx < 0.0
    a_left, b_left = left_x * ay - left_y * ax > 0.0, left_x * by - left_y * bx > 0.0
    if fan.width > np.pi:
        return a_right and b_right and a_left and b_left
    return (a_right and b_right) or (a_left and b_left)


@njit(cache=True, error_model="numpy")
def _meet_caps(x, y, z, k, obstacles, fan):
    """Test a whole fan against top and underside of solid k."""
    for b in range(len(fan.dx)):
        r = _cap_range(x, y, z, fan.dx[b], fan.dy[b], fan.dz[b], k, fan.nearest[b], obstacles)
        if r < np.inf:
            fan.nearest[b], fan.hit[b] = r, LEVEL


@njit(cache=True, error_model="numpy")
def _see_box(x, y, box, cells, fan):
    """All within a box of cells around a point has been looked at: to where each ray leaves it."""
    x_lo, x_hi = cells.x0 + cells.size * box[0] - x, cells.x0 + cells.size * box[1] - x
    y_lo, y_hi = cells.y0 + cells.size * box[2] - y, cells.y0 + cells.size * box[3] - y
    dx, dy, seen = fan.dx, fan.dy, fan.seen
    for b in range(len(dx)):
        to_x, to_y = (x_hi if dx[b] > 0.0 else x_lo) / dx[b], (y_hi if dy[b] > 0.0 else y_lo) / dy[b]
        to_x, to_y = to_x if dx[b] != 0.0 else np.inf, to_y if dy[b] != 0.0 else np.inf
        seen[b] = to_x if to_x < to_y else to_y


@njit(cache=True, error_model="numpy")
def _enter_grid(x, y, cells, fan):
    """Distances at which the rays of a point outside the grid enter it, inf where they do not."""
    x_lo, y_lo = cells.x0 + cells.size, cells.y0 + cells.size
    x_hi, y_hi = cells.x0 + cells.size * (cells.columns - 1), cells.y0 + cells.size * (cells.rows - 1)
    for b in range(len(fan.dx)):
        enter, leave = clip_to(x, fan.dx[b], x_lo, x_hi, 0.0, np.inf)
        enter, leave = clip_to(y, fan.dy[b], y_lo, y_hi, enter, leave)
        fan.seen[b] = enter if enter < leave else np.inf


@njit(cache=True, error_model="numpy")
def _walk(x, y, z, reach, planar, scene, fan):
    """Follow every ray that has not met anything in what it has seen, box by box."""
    cells, obstacles = scene.cells, scene.obstacles
    leaps, copies, shapes, edge_count = cells.leaps, cells.copies, cells.shapes, len(cells.plates)
    columns, rows, scale = cells.columns, cells.rows, 1.0 / cells.size
    gx, gy = (x - cells.x0) * scale, (y - cells.y0) * scale
    for b in range(len(fan.dx)):
        nearest, seen, hit = fan.nearest[b], fan.seen[b], fan.hit[b]
        if min(nearest, reach) <= seen:
            continue
        dx, dy, dz = fan.dx[b], fan.dy[b], fan.dz[b]
        per_x = cells.size / dx if dx != 0.0 else HUGE
        per_y = cells.size / dy if dy != 0.0 else HUGE
        kx, ky = dx * scale, dy * scale
        side_x, side_y = (1 if dx >= 0.0 else 0), (3 if dy >= 0.0 else 2)
        at_x, at_y = gx + (NUDGE if dx >= 0.0 else -NUDGE), gy + (NUDGE if dy >= 0.0 else -NUDGE)
        while True:
            i, j = int(at_x + seen * kx), int(at_y + seen * ky)
            if i < 1 or j < 1 or i >= columns - 1 or j >= rows - 1:
                break
            c = j * columns + i
            for n in range(leaps[c, 4], leaps[c, 5]):
                r = plate_range(
                    copies[n, 0] - x, copies[n, 1] - y, copies[n, 2] - x, copies[n, 3] - y, dx, dy
                )
                if r < nearest and (planar or copies[n, 4] <= z + dz * r <= copies[n, 5]):
                    nearest, hit = r, shapes[n]
            if not planar:
                for n in range(leaps[c, 5], leaps[c, 6]):
                    r = _cap_range(x, y, z, dx, dy, dz, shapes[n] - edge_count, nearest, obstacles)
                    if r < nearest:
                        nearest, hit = r, LEVEL
            seen = min((leaps[c, side_x] - gx) * per_x, (leaps[c, side_y] - gy) * per_y)
            if min(nearest, reach) <= seen:
                break
        fan.nearest[b], fan.hit[b] = nearest, hit


@njit(cache=True, error_model="numpy")
def _cast_fan(x, y, z, reach, planar, scene, fan):
    """Nearest hit of every ray of a fan, within ``reach``."""
    cells = scene.cells
    _bound(z, scene, planar, fan)
    i, j = math.floor((x - cells.x0) / cells.size), math.floor((y - cells.y0) / cells.size)
    if 1 <= i < cells.columns - 1 and 1 <= j < cells.rows - 1:
        c = j * cells.columns + i
        if _is_inside_solid(x, y, z, c, planar, scene):
            for b in range(len(fan.hit)):
                fan.nearest[b], fan.hit[b] = 0.0, INSIDE
            return
        _look_around(x, y, z, c, planar, scene, fan)
    else:
        _enter_grid(x, y, cells, fan)
    _walk(x, y, z, reach, planar, scene, fan)
    if scene.has_ground and not planar and not scene.ground.is_level:
        for b in range(len(fan.dx)):
            limit = min(fan.nearest[b], reach)
            r = ground_range(x, y, z, fan.dx[b], fan.dy[b], fan.dz[b], limit, scene.ground)
            if r < fan.nearest[b]:
                fan.nearest[b], fan.hit[b] = r, GROUND


@njit(cache=True, error_model="numpy")
def _incidence(x, y, scene, fan, cosines):
    """Cosine of the angle between each ray and the normal of what it met; 1 inside a solid, and for none."""
    planes = scene.obstacles.planes
    for b in range(len(cosines)):
        dx, dy, dz, hit = fan.dx[b], fan.dy[b], fan.dz[b], fan.hit[b]
        cosines[b] = 1.0
        if hit >= 0:
            cosines[b] = abs(planes[hit, 0] * dx + planes[hit, 1] * dy)
        elif hit == LEVEL:
            cosines[b] = abs(dz)
        elif hit == GROUND:
            r = fan.nearest[b]
            nx, ny, nz = ground_normal(x + dx * r, y + dy * r, scene.ground.field)
            cosines[b] = abs(nx * dx + ny * dy + nz * dz)


@njit(cache=True, error_model="numpy")
def cast_beams(poses, angles, c, s, reach, planar, scene, ranges, cosines):
    """Cast beams at angles (B), whose cosines and sines are c and s, of every pose (N, 6).

    Writes ranges (N, B), NaN for nothing, and cosines of the incidence where ``cosines`` is (N, B) too,
    rather than empty. ``planar``: only x, y and yaw count, every obstacle is endlessly high, and there is
    neither floor nor ceiling.
    """
    beams = len(c)
    nearest, seen, hit = np.empty(beams), np.empty(beams), np.empty(beams, dtype=np.int64)
    dx, dy, dz, (right, left, width) = np.empty(beams), np.empty(beams), np.empty(beams), _outermost(angles)
    for n in range(len(poses)):
        x, y, roll, pitch, z = poses[n, 0], poses[n, 1], poses[n, 3], poses[n, 4], poses[n, 5]
        is_upright = np.cos(roll) * np.cos(pitch) > UPRIGHT
        fan = Fan(right, left, width if is_upright else np.inf, dx, dy, dz, nearest, hit, seen)
        _aim(poses[n], c, s, fan)
        _cast_fan(x, y, z, reach, planar, scene, fan)
        for b in range(beams):
            ranges[n, b] = nearest[b] if nearest[b] <= reach and nearest[b] < np.inf else np.nan
        if cosines.size > 0:
            _incidence(x, y, scene, fan, cosines[n])
