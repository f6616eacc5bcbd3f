"""The laser and obstacles that move: a second ray cast over them, after that of the still world."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numba import njit
from numpy.typing import ArrayLike

from sim.terrain import Terrain
from sim.terrain_kernels import beam_directions, heights_at
from sim.world import Obstacles
from slam.se2 import Array


@dataclass(frozen=True)
class MovingObstacles:
    """Solids in their body frames and, at N scans, their ``poses (N, K, 4)``: x, y, yaw and ground height."""

    solids: Obstacles
    poses: Array

    @classmethod
    def on_ground(cls, solids: Obstacles, poses: ArrayLike, terrain: Terrain) -> MovingObstacles:
        """Solids at poses ``(N, K, 3)``, each as high as the ground under it."""
        poses = np.ascontiguousarray(poses, dtype=np.float64)
        z = heights_at(np.ascontiguousarray(poses[..., :2]).reshape(-1, 2), terrain.field)
        return cls(solids, np.dstack([poses, z.reshape(poses.shape[:2])]))

    def without_heights(self) -> MovingObstacles:
        """The same, endlessly high."""
        return replace(self, solids=self.solids.without_heights())

    def cast(
        self, poses: Array, angles: Array, reach: float, ranges: Array, cosines: Array
    ) -> tuple[Array, Array]:
        """Ranges and incidence cosines ``(N, B)`` of what is nearer: the still world as given, or a mover.

        ``poses (N, 6)`` are the sensor's, ``angles (B,)`` rad the beams'; NaN is a beam that meets nothing.
        """
        ranges, cosines = ranges.copy(), cosines.copy()
        corners = np.hypot(self.solids.edges[:, 0], self.solids.edges[:, 1])
        radius = np.maximum.reduceat(corners, self.solids.first[:-1])
        _cast_movers(poses, angles, reach, self.solids, self.poses, radius, ranges, cosines)
        return ranges, cosines


@njit(cache=True, error_model="numpy")
def _cast_movers(poses, angles, reach, solids, movers, radius, ranges, cosines):
    for n in range(len(poses)):
        directions = beam_directions(poses[n], angles)
        for k in range(movers.shape[1]):
            ox, oy = poses[n, 0] - movers[n, k, 0], poses[n, 1] - movers[n, k, 1]
            if ox * ox + oy * oy > (reach + radius[k]) ** 2:
                continue
            c, s = np.cos(movers[n, k, 2]), np.sin(movers[n, k, 2])
            x, y, z = c * ox + s * oy, c * oy - s * ox, poses[n, 5] - movers[n, k, 3]
            for b in range(len(angles)):
                dx, dy, dz = directions[b]
                if abs(ox * dy - oy * dx) > radius[k] * np.hypot(dx, dy):
                    continue
                r, cosine = solid_hit(x, y, z, c * dx + s * dy, c * dy - s * dx, dz, k, solids)
                if r <= reach and not r >= ranges[n, b]:
                    ranges[n, b], cosines[n, b] = r, cosine


@njit(cache=True, error_model="numpy")
def solid_hit(x, y, z, dx, dy, dz, k, solids):
    """Slant range at which a ray meets solid k (else inf), and the cosine of its incidence.

    The chord through the convex footprint is where all its half-planes agree; then front, top or underside.
    """
    enter, leave, facing = 0.0, np.inf, 1.0
    for e in range(solids.first[k], solids.first[k + 1]):
        nx, ny, offset = solids.planes[e]
        gap, speed = offset - nx * x - ny * y, nx * dx + ny * dy
        if speed < 0.0 and gap / speed > enter:
            enter, facing = gap / speed, -speed
        elif speed > 0.0:
            leave = min(leave, gap / speed)
        elif speed == 0.0 and gap < 0.0:
            return np.inf, 1.0
    if enter > leave:
        return np.inf, 1.0
    z_lo, z_hi = solids.z_lo[k], solids.z_hi[k]
    z_in, z_out = z + dz * enter, z + dz * leave
    if z_lo <= z_in <= z_hi:
        return enter, facing
    if z_in > z_hi and z_out < z_hi:
        return (z_hi - z) / dz, abs(dz)
    if z_in < z_lo and z_out > z_lo:
        return (z_lo - z) / dz, abs(dz)
    return np.inf, 1.0
