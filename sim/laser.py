"""The laser: an exact ray caster for a scan plane that tilts, and the scanner that corrupts what it sees."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numba import njit
from numpy.typing import ArrayLike

from sim import cells, laser_effects, traversal
from sim.laser_effects import Effects
from sim.smoke import Haze, Smoke
from sim.terrain import Terrain
from sim.terrain_kernels import beam_directions, build_ground, heights_at
from sim.world import Obstacles, World, plates
from slam.recording import Laser
from slam.se2 import Array


class Raycaster:
    """Exact ranges from poses in a world.

    In a planar cast (poses ``(N, 3)``) every obstacle counts whatever its height, and there is neither
    floor nor ceiling. In a tilted cast (poses ``(N, 6)``) obstacles have heights: a ray passes over or
    under them, meets their front, lands on their top, or meets their underside.
    """

    def __init__(self, world: World | Obstacles, floor: bool = True, heights: bool = True) -> None:
        """Ray caster over all that stands still; without ``floor`` there is no ceiling either, without
        ``heights`` all is endlessly high."""
        obstacles = world if isinstance(world, Obstacles) else world.obstacles
        obstacles = obstacles if heights else obstacles.without_heights()
        ground, ceiling = Terrain.level([0.0, 0.0], [1.0, 1.0], 1.0), np.inf
        if has_ground := floor and isinstance(world, World):
            ground, ceiling = world.terrain, float(world.ceiling)
        self._scene = traversal.Scene(
            obstacles, cells.build(obstacles), build_ground(ground.field), has_ground, ceiling
        )

    @classmethod
    def from_segments(cls, segments: ArrayLike, heights: ArrayLike | None = None) -> Raycaster:
        """Ray caster over thin walls ``segments (S, 4)`` m, without floor or ceiling.

        ``heights (S,)`` or ``(S, 2)`` m are their tops, or bottoms and tops; None: endless.
        Raises ``ValueError`` for other shapes or a segment without length.
        """
        return cls(plates(segments, heights))

    def cast(self, poses: ArrayLike, angles: ArrayLike, range_max: float = np.inf) -> Array:
        """Slant ranges ``(N, B)`` m of the beams at ``angles (B,)`` rad, NaN where nothing is met.

        ``poses`` are of the sensor: ``(N, 3)`` x, y, yaw, or ``(N, 6)`` x, y, yaw, roll, pitch, z with roll
        left side up and pitch nose down positive, R = Rz(yaw) Ry(pitch) Rx(roll). Nothing is met beyond
        ``range_max``. Raises ``ValueError`` for other shapes or poses that are not finite.
        """
        return self.cast_with_incidence(poses, angles, range_max, incidence=False)[0]

    def cast_with_incidence(
        self, poses: ArrayLike, angles: ArrayLike, range_max: float = np.inf, incidence: bool = True
    ) -> tuple[Array, Array]:
        """Ranges as `cast`, and the cosine of the angle between beam and surface normal, both ``(N, B)``."""
        poses = np.ascontiguousarray(poses, dtype=np.float64)
        angles = np.ascontiguousarray(angles, dtype=np.float64)
        if poses.ndim != 2 or poses.shape[1] not in (3, 6) or angles.ndim != 1:
            shapes = f"{poses.shape}, {angles.shape}"
            raise ValueError(f"expected poses (N, 3) or (N, 6) and angles (B,), got {shapes}")
        if not (np.all(np.isfinite(poses)) and np.all(np.isfinite(angles))):
            raise ValueError("poses and angles must be finite")
        planar = poses.shape[1] == 3
        if planar:
            poses = np.hstack([poses, np.zeros_like(poses)])
        ranges = np.empty((len(poses), len(angles)))
        cosines = np.empty_like(ranges) if incidence else np.empty((0, 0))
        c, s = np.cos(angles), np.sin(angles)
        traversal.cast_beams(poses, c, s, float(range_max), planar, self._scene, ranges, cosines)
        return ranges, cosines


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
        directions = beam_directions(poses[n], np.cos(angles), np.sin(angles))
        for k in range(movers.shape[1]):
            ox, oy = poses[n, 0] - movers[n, k, 0], poses[n, 1] - movers[n, k, 1]
            if ox * ox + oy * oy > (reach + radius[k]) ** 2:
                continue
            c, s = np.cos(movers[n, k, 2]), np.sin(movers[n, k, 2])
            x, y, z = c * ox + s * oy, c * oy - s * ox, poses[n, 5] - movers[n, k, 3]
            for b in range(len(angles)):
                dx, dy, dz = directions[0, b], directions[1, b], directions[2, b]
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


@dataclass(frozen=True)
class Scanner:
    """A laser on a robot; the defaults are the Hokuyo of USARSim's Kenaf."""

    beams: int = 228
    """In a scan."""
    field_of_view: float = 4.1889
    """From the first beam to the last [rad]."""
    range_min: float = 0.1
    """Least range that is reported [m]."""
    range_max: float = 4.0
    """Ranges from this on are not reported [m]."""
    mount: tuple[float, float, float] = (-0.08, 0.0, 0.0)
    """Pose in the robot's frame: x, y [m], yaw [rad]."""
    height: float = 0.30
    """Above the ground [m]."""
    effects: Effects = field(default_factory=Effects)
    """What its scans suffer."""

    @property
    def angles(self) -> Array:
        """Beam angles ``(B,)`` rad in the laser frame, counter-clockwise, symmetric about its x axis."""
        return np.linspace(-0.5 * self.field_of_view, 0.5 * self.field_of_view, self.beams)

    @property
    def laser(self) -> Laser:
        """What a recording says about this laser."""
        return Laser(self.range_min, self.range_max, self.effects.sigma, np.array(self.mount))

    def sensor_poses(self, robot: ArrayLike) -> Array:
        """Poses ``(N, 6)`` of the laser, with the robot's yaw.

        ``robot (N, 6)``: x, y, yaw, roll, pitch, z of the ground under it.
        """
        x, y, yaw, roll, pitch, z = np.moveaxis(np.asarray(robot, dtype=np.float64), -1, 0)
        if not self.effects.tilt:
            roll, pitch = np.zeros_like(roll), np.zeros_like(pitch)
        mx, my, _ = self.mount
        forward = np.cos(pitch) * mx + np.sin(pitch) * (np.sin(roll) * my + np.cos(roll) * self.height)
        left = np.cos(roll) * my - np.sin(roll) * self.height
        up = -np.sin(pitch) * mx + np.cos(pitch) * (np.sin(roll) * my + np.cos(roll) * self.height)
        c, s = np.cos(yaw), np.sin(yaw)
        return np.stack(
            [x + c * forward - s * left, y + s * forward + c * left, yaw, roll, pitch, z + up], -1
        )

    def caster(self, world: World) -> Raycaster:
        """The still world as this laser's effects let it be seen."""
        return Raycaster(world, self.effects.floor, self.effects.heights)

    def scan(
        self,
        caster: Raycaster,
        robot: ArrayLike,
        rng: np.random.Generator,
        movers: MovingObstacles | None = None,
        smoke: Smoke | None = None,
    ) -> Array:
        """Ranges ``(N, B)`` m as the laser reports them from robot poses (N, 6), NaN without return.

        ``caster`` sees what stands still; ``movers`` at the N scans and ``smoke`` come before that.
        """
        poses = self.sensor_poses(robot)
        spread = self.effects.footprint(self.angles + self.mount[2])
        reach = self.range_max + 1.0  # sub-rays beyond the limit still belong to a mixed pixel
        ranges, cosines = caster.cast_with_incidence(poses, spread.ravel(), reach)
        if movers is not None:
            seen = movers if self.effects.heights else movers.without_heights()
            ranges, cosines = seen.cast(poses, spread.ravel(), reach, ranges, cosines)
        haze = None if smoke is None else Haze(smoke.field, poses, self.angles + self.mount[2])
        shape, limits = (len(poses), *spread.shape), (self.range_min, self.range_max)
        return laser_effects.corrupt(
            ranges.reshape(shape), cosines.reshape(shape), self.effects, limits, rng, haze
        )
