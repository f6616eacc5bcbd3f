"""Smoke: an extinction coefficient over the plane, and where a beam that enters it is scattered."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import ArrayLike

from sim.terrain_kernels import HeightField, beam_directions, clip_to, next_cell
from slam.se2 import Array


@dataclass(frozen=True)
class Smoke:
    """Extinction coefficient κ [1/m] on a grid of nodes, bilinear in between, none outside, at every height.

    ``extinction (rows, columns)`` at ``origin + resolution * (column, row)``. A beam travels 1/κ m on average
    before it is scattered (Beer-Lambert). Raises ``ValueError`` for negative or infinite values.
    """

    extinction: Array
    origin: tuple[float, float]
    resolution: float

    def __post_init__(self) -> None:
        if self.extinction.ndim != 2 or min(self.extinction.shape) < 2:
            raise ValueError("smoke: extinction needs a shape of at least (2, 2)")
        if not (np.all(np.isfinite(self.extinction)) and np.all(self.extinction >= 0.0)):
            raise ValueError("smoke: expected finite extinction >= 0")

    @classmethod
    def clear(cls, lower: ArrayLike, upper: ArrayLike, resolution: float = 0.1) -> Smoke:
        """Clear air over the rectangle from ``lower (2,)`` to ``upper (2,)`` m."""
        lower, upper = np.asarray(lower, dtype=np.float64), np.asarray(upper, dtype=np.float64)
        columns, rows = np.ceil((upper - lower) / resolution).astype(int) + 1
        return cls(np.zeros((int(rows), int(columns))), (float(lower[0]), float(lower[1])), resolution)

    @property
    def field(self) -> HeightField:
        """The coefficient as a field for the kernels, looked up like a height."""
        extinction = np.ascontiguousarray(self.extinction)
        return HeightField(extinction, *self.origin, self.resolution, float(extinction.max()))

    def with_disc(self, centre: ArrayLike, radius: float, extinction: float, edge: float = 0.0) -> Smoke:
        """More smoke, in a disc: it thins out linearly over the outer ``edge`` m."""
        x, y = self.field.nodes()
        cx, cy = np.asarray(centre, dtype=np.float64)
        return self._thicker(radius - np.hypot(x - cx, y - cy), extinction, edge)

    def with_polygon(self, corners: ArrayLike, extinction: float, edge: float = 0.0) -> Smoke:
        """More smoke, in a simple polygon ``corners (K, 2)`` m: it thins out over the outer ``edge`` m."""
        x, y = self.field.nodes()
        corners = np.asarray(corners, dtype=np.float64)
        inside = np.zeros(x.shape, dtype=bool)
        depth = np.full(x.shape, np.inf)
        for (ax, ay), (bx, by) in zip(corners, np.roll(corners, -1, axis=0), strict=True):
            ex, ey = bx - ax, by - ay
            t = np.clip(((x - ax) * ex + (y - ay) * ey) / (ex * ex + ey * ey), 0.0, 1.0)
            depth = np.minimum(depth, np.hypot(x - ax - t * ex, y - ay - t * ey))
            if ey != 0.0:  # even-odd rule: sides that a line to the right crosses
                inside ^= ((ay > y) != (by > y)) & (x < ax + (y - ay) * ex / ey)
        return self._thicker(np.where(inside, depth, -depth), extinction, edge)

    def _thicker(self, depth: Array, extinction: float, edge: float) -> Smoke:
        """Add smoke where ``depth`` m, the distance inwards from the boundary, is positive."""
        share = np.where(depth >= 0.0, np.clip(depth / edge, 0.0, 1.0) if edge > 0.0 else 1.0, 0.0)
        return replace(self, extinction=self.extinction + extinction * share)


class Haze(NamedTuple):
    """Smoke as the laser sees it: its field, sensor ``poses (N, 6)`` and beam ``angles (B,)`` rad."""

    field: HeightField
    poses: Array
    angles: Array

    def scatter(self, ranges: Array, thickness: Array) -> tuple[Array, Array]:
        """Where beams are scattered, and how much smoke lies before what they would meet.

        ``ranges (N, B)`` m to what each beam would meet in clear air; a beam is scattered where its optical
        depth reaches ``thickness (N, B)``. Returns the distance m, inf for a beam that gets through, and the
        optical depth up to there or up to the range.
        """
        at, depth = np.empty_like(ranges), np.empty_like(ranges)
        _scatter(self.poses, self.angles, ranges, thickness, self.field, at, depth)
        return at, depth


@njit(cache=True, error_model="numpy")
def _scatter(poses, angles, ranges, thickness, field, at, depth):
    for n in range(len(poses)):
        x, y = poses[n, 0], poses[n, 1]
        dx, dy, _ = beam_directions(poses[n], np.cos(angles), np.sin(angles))
        for b in range(len(angles)):
            at[n, b], depth[n, b] = _pierce(x, y, dx[b], dy[b], ranges[n, b], thickness[n, b], field)


@njit(cache=True, error_model="numpy")
def _pierce(x, y, dx, dy, reach, thickness, field):
    """Distance at which a ray's optical depth comes to ``thickness`` (else inf), and the depth at its end.

    The ray is point + r · direction and ends there or at ``reach``. Cell by cell κ is bilinear, hence
    quadratic along the ray, and its integral a cubic: exact, whatever the resolution.
    """
    rows, columns = field.heights.shape
    res = field.resolution
    enter, leave = clip_to(x, dx, field.x0, field.x0 + (columns - 1) * res, 0.0, reach)
    enter, leave = clip_to(y, dy, field.y0, field.y0 + (rows - 1) * res, enter, leave)
    if not enter < leave or (dx == 0.0 and dy == 0.0):
        return np.inf, 0.0
    i = min(max(int((x + dx * enter - field.x0) / res), 0), columns - 2)
    j = min(max(int((y + dy * enter - field.y0) / res), 0), rows - 2)
    depth, r = 0.0, enter
    while r < leave and 0 <= i < columns - 1 and 0 <= j < rows - 1:
        border, next_i, next_j = next_cell(x, y, dx, dy, i, j, field.x0, field.y0, res)
        end = max(r, min(border, leave))
        a, b, c = _along(x + dx * r, y + dy * r, dx, dy, i, j, field)
        more = _depth(a, b, c, end - r)
        if depth + more >= thickness:
            return r + _crossing(a, b, c, end - r, thickness - depth), thickness
        depth += more
        r, i, j = end, next_i, next_j
    return np.inf, depth


@njit(cache=True, error_model="numpy")
def _along(x, y, dx, dy, i, j, field):
    """κ on a ray in cell (i, j) as a + b t + c t², t m after the point (x, y)."""
    k = field.heights
    k00, k10, k01, k11 = k[j, i], k[j, i + 1], k[j + 1, i], k[j + 1, i + 1]
    fx, fy = (x - field.x0) / field.resolution - i, (y - field.y0) / field.resolution - j
    gx, gy = dx / field.resolution, dy / field.resolution
    p, q, w = k10 - k00, k01 - k00, k11 - k10 - k01 + k00
    return k00 + p * fx + q * fy + w * fx * fy, p * gx + q * gy + w * (fx * gy + fy * gx), w * gx * gy


@njit(cache=True, error_model="numpy")
def _depth(a, b, c, t):
    """Integral of κ over the first ``t`` m."""
    return ((c * t / 3.0 + 0.5 * b) * t + a) * t


@njit(cache=True, error_model="numpy")
def _crossing(a, b, c, span, wanted):
    """Length within ``span`` m over which the integral of κ grows to ``wanted``."""
    low, high = 0.0, span
    for _ in range(50):
        middle = 0.5 * (low + high)
        if _depth(a, b, c, middle) < wanted:
            low = middle
        else:
            high = middle
    return high
