"""The ground: a height field, with ramps, sills and rubble, and its exact intersection with a ray."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import ArrayLike
from scipy.ndimage import gaussian_filter

from slam.se2 import Array


class HeightField(NamedTuple):
    """What the kernels read: node ``heights (rows, columns)``, origin, resolution, highest node [m]."""

    heights: Array
    x0: float
    y0: float
    resolution: float
    highest: float


@dataclass(frozen=True)
class Terrain:
    """Heights and roughness on a grid of nodes, bilinear in between, level ground at height 0 outside.

    ``heights (rows, columns)`` m at ``origin + resolution * (column, row)``; ``roughness`` of the same
    shape is the standard deviation [rad] that loose rubble adds to the tilt of a robot that drives over it.
    """

    heights: Array
    roughness: Array
    origin: tuple[float, float]
    resolution: float

    def __post_init__(self) -> None:
        if (
            self.heights.ndim != 2
            or min(self.heights.shape) < 2
            or self.heights.shape != self.roughness.shape
        ):
            raise ValueError("terrain: heights and roughness need the same shape, at least (2, 2)")
        if not (np.all(np.isfinite(self.heights)) and np.all(self.roughness >= 0.0)):
            raise ValueError("terrain: expected finite heights and roughness >= 0")

    @classmethod
    def level(cls, lower: ArrayLike, upper: ArrayLike, resolution: float = 0.05) -> Terrain:
        """Level ground over the rectangle from ``lower (2,)`` to ``upper (2,)`` m."""
        lower, upper = np.asarray(lower, dtype=np.float64), np.asarray(upper, dtype=np.float64)
        columns, rows = np.ceil((upper - lower) / resolution).astype(int) + 1
        zeros = np.zeros((int(rows), int(columns)))
        return cls(zeros, zeros.copy(), (float(lower[0]), float(lower[1])), resolution)

    @property
    def field(self) -> HeightField:
        """The height field, for the kernels."""
        heights = np.ascontiguousarray(self.heights)
        return HeightField(heights, *self.origin, self.resolution, max(0.0, float(heights.max())))

    @property
    def roughness_field(self) -> HeightField:
        """The roughness, to be looked up like a height."""
        return self.field._replace(heights=np.ascontiguousarray(self.roughness))

    def nodes(self) -> tuple[Array, Array]:
        """x and y of every node, each ``(rows, columns)`` m."""
        rows, columns = self.heights.shape
        x = self.origin[0] + self.resolution * np.arange(columns)
        y = self.origin[1] + self.resolution * np.arange(rows)
        columns_x, rows_y = np.meshgrid(x, y)
        return columns_x, rows_y

    def with_ramp(self, a: ArrayLike, b: ArrayLike, width: float, rise: float) -> Terrain:
        """A ramp from the ground at ``a (2,)`` up to ``rise`` m at ``b (2,)``, where it drops: a ledge."""
        along, across, length = self._strip(a, b)
        inside = (np.abs(across) <= 0.5 * width) & (along >= 0.0) & (along <= length)
        return self._raised(np.where(inside, rise * along / length, 0.0))

    def with_steps(self, a: ArrayLike, b: ArrayLike, width: float, rise: float, count: int) -> Terrain:
        """A flight of ``count`` equal steps from the ground at ``a (2,)`` up to ``rise`` m at ``b (2,)``."""
        along, across, length = self._strip(a, b)
        inside = (np.abs(across) <= 0.5 * width) & (along >= 0.0) & (along <= length)
        step = np.clip(np.floor(along / length * count + 1e-9) + 1.0, 1.0, count)
        return self._raised(np.where(inside, rise * step / count, 0.0))

    def with_platform(self, lower: ArrayLike, upper: ArrayLike, height: float) -> Terrain:
        """The rectangle from ``lower (2,)`` to ``upper (2,)`` m raised to a level ``height`` m."""
        return self._raised(np.where(self._depth(lower, upper) >= 0.0, height, 0.0))

    def with_sill(self, a: ArrayLike, b: ArrayLike, height: float, depth: float) -> Terrain:
        """A door sill: a rounded bar from ``a (2,)`` to ``b (2,)``, ``depth`` m across, ``height`` m high."""
        along, across, length = self._strip(a, b)
        inside = (np.abs(across) <= 0.5 * depth) & (along >= 0.0) & (along <= length)
        return self._raised(np.where(inside, height * np.cos(np.pi * across / depth), 0.0))

    def with_rubble(
        self,
        centre: ArrayLike,
        radius: float,
        height: float,
        roughness: float,
        rng: np.random.Generator,
        grain: float = 0.25,
    ) -> Terrain:
        """A round heap of debris: random bumps of typical ``height`` m and size ``grain`` m, fading at its
        edge.

        ``roughness`` [rad] is the tilt its loose parts add to a robot driving over it.
        """
        x, y = self.nodes()
        cx, cy = np.asarray(centre, dtype=np.float64)
        fade = np.clip(1.5 * (1.0 - np.hypot(x - cx, y - cy) / radius), 0.0, 1.0)
        return self._strewn(fade, height, roughness, rng, grain)

    def with_rubble_field(
        self,
        lower: ArrayLike,
        upper: ArrayLike,
        height: float,
        roughness: float,
        rng: np.random.Generator,
        grain: float = 0.25,
    ) -> Terrain:
        """Rubble as `with_rubble`, over the rectangle from ``lower (2,)`` to ``upper (2,)`` m.

        It fades over the outer 0.3 m. A ``grain`` of metres without roughness makes hills.
        """
        fade = np.clip(self._depth(lower, upper) / 0.3, 0.0, 1.0)
        return self._strewn(fade, height, roughness, rng, grain)

    def _strewn(
        self, fade: Array, height: float, roughness: float, rng: np.random.Generator, grain: float
    ) -> Terrain:
        """Rubble where ``fade (rows, columns)``, from 0 to 1, lets it be."""
        noise = gaussian_filter(
            rng.standard_normal(self.heights.shape), grain / self.resolution, mode="reflect"
        )
        bumps = np.abs(noise) * (height / np.abs(noise).mean())
        rough = np.maximum(self.roughness, fade * roughness)
        return replace(self, heights=np.maximum(self.heights, fade * bumps), roughness=rough)

    def _depth(self, lower: ArrayLike, upper: ArrayLike) -> Array:
        """Distance [m] of every node inwards from the nearest side of a rectangle; negative outside it."""
        (x0, y0), (x1, y1) = np.asarray(lower, dtype=np.float64), np.asarray(upper, dtype=np.float64)
        x, y = self.nodes()
        tolerance = 1e-9  # nodes on the border belong to it
        return np.minimum(np.minimum(x - x0, x1 - x), np.minimum(y - y0, y1 - y)) + tolerance

    def _raised(self, heights: Array) -> Terrain:
        return replace(self, heights=np.maximum(self.heights, heights))

    def _strip(self, a: ArrayLike, b: ArrayLike) -> tuple[Array, Array, float]:
        """Coordinates of every node along and across the line from a to b, and its length."""
        a, b = np.asarray(a, dtype=np.float64), np.asarray(b, dtype=np.float64)
        length = float(np.hypot(*(b - a)))
        ux, uy = (b - a) / length
        x, y = self.nodes()
        return (x - a[0]) * ux + (y - a[1]) * uy, (y - a[1]) * ux - (x - a[0]) * uy, length


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
def ground_hit(x, y, z, dx, dy, dz, reach, field):
    """Distance along a ray to the ground, inf when it is not met within ``reach``.

    The ray is point + r · direction. Cell by cell the ground is bilinear, hence quadratic along the ray: its
    first root is the hit, so nothing thinner than a marching step is missed.
    """
    start, stop = 0.0, reach
    if dz < 0.0:  # only where the ray is below the highest ground
        start = max(start, (field.highest - z) / dz)
    elif dz > 0.0:
        stop = min(stop, (field.highest - z) / dz)
    elif z > field.highest:
        return np.inf
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
    step_i, step_j = (1 if dx > 0.0 else -1), (1 if dy > 0.0 else -1)
    r = enter
    while True:
        next_x = (field.x0 + (i + (step_i > 0)) * res - x) / dx if dx != 0.0 else np.inf
        next_y = (field.y0 + (j + (step_j > 0)) * res - y) / dy if dy != 0.0 else np.inf
        end = max(r, min(next_x, next_y, leave))
        hit = _hit_in_cell(x + dx * r, y + dy * r, z + dz * r, dx, dy, dz, i, j, end - r, field)
        if hit < np.inf:
            return r + hit
        if end >= leave:
            return np.inf
        if next_x <= next_y:
            i += step_i
        else:
            j += step_j
        if not (0 <= i < columns - 1 and 0 <= j < rows - 1):
            return np.inf
        r = end


@njit(cache=True, error_model="numpy")
def ground_normal(x, y, field):
    """Unit normal (3) of the ground, upwards, by central differences over a thousandth of a cell."""
    e = 1e-3 * field.resolution
    gx = (height_at(x + e, y, field) - height_at(x - e, y, field)) / (2.0 * e)
    gy = (height_at(x, y + e, field) - height_at(x, y - e, field)) / (2.0 * e)
    n = 1.0 / np.sqrt(1.0 + gx * gx + gy * gy)
    return -gx * n, -gy * n, n
