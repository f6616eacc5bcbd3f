"""The laser: an exact ray caster for a scan plane that tilts, and the scanner that corrupts what it sees."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from sim import cells, corruption, traversal
from sim.corruption import Effects
from sim.moving_obstacle_raycast import MovingObstacles
from sim.smoke import Haze, Smoke
from sim.terrain import Terrain
from sim.terrain_kernels import build_ground
from sim.world import Obstacles, World, plates
from slam.recording import Laser
from slam.se2 import Array


class Raycaster:
    """Exact ranges from poses in a world.

    In a planar cast (poses ``(N, 3)``) every obstacle counts whatever its height, and there is neither
    floor nor ceiling. In a tilted cast (poses ``(N, 6)``) obstacles have heights: a ray passes over or
    under them, meets their front, lands on their top, or meets their underside.
    """

    def __init__(self, world: World, floor: bool = True) -> None:
        """Ray caster over all that stands still; without ``floor`` there is no ceiling either."""
        self._prepare(world.obstacles, world.terrain if floor else None, world.ceiling)

    @classmethod
    def from_segments(cls, segments: ArrayLike, heights: ArrayLike | None = None) -> Raycaster:
        """Ray caster over thin walls ``segments (S, 4)`` m, without floor or ceiling.

        ``heights (S,)`` or ``(S, 2)`` m are their tops, or bottoms and tops; None: endless.
        Raises ``ValueError`` for other shapes or a segment without length.
        """
        caster = cls.__new__(cls)
        caster._prepare(plates(segments, heights))
        return caster

    def _prepare(self, obstacles: Obstacles, terrain: Terrain | None = None, ceiling: float = np.inf) -> None:
        field = (terrain or Terrain.level([0.0, 0.0], [1.0, 1.0], 1.0)).field
        self._scene = traversal.Scene(
            obstacles, cells.build(obstacles), build_ground(field), terrain is not None, float(ceiling)
        )

    def cast(self, poses: ArrayLike, angles: ArrayLike, range_max: float = np.inf) -> Array:
        """Slant ranges ``(N, B)`` m of the beams at ``angles (B,)`` rad, NaN where nothing is met.

        ``poses`` are of the sensor: ``(N, 3)`` x, y, yaw, or ``(N, 6)`` x, y, yaw, roll, pitch, z with roll
        left side up and pitch nose down positive, R = Rz(yaw) Ry(pitch) Rx(roll). Nothing is met beyond
        ``range_max``. Raises ``ValueError`` for other shapes or poses that are not finite.
        """
        ranges, _ = self._cast(poses, angles, range_max, incidence=False)
        return ranges

    def cast_with_incidence(
        self, poses: ArrayLike, angles: ArrayLike, range_max: float = np.inf
    ) -> tuple[Array, Array]:
        """Ranges as `cast`, and the cosine of the angle between beam and surface normal, both ``(N, B)``."""
        return self._cast(poses, angles, range_max, incidence=True)

    def _cast(
        self, poses: ArrayLike, angles: ArrayLike, range_max: float, incidence: bool
    ) -> tuple[Array, Array]:
        poses = np.ascontiguousarray(poses, dtype=np.float64)
        angles = np.ascontiguousarray(angles, dtype=np.float64)
        if poses.ndim != 2 or poses.shape[1] not in (3, 6) or angles.ndim != 1:
            raise ValueError(
                f"expected poses (N, 3) or (N, 6) and angles (B,), got {poses.shape}, {angles.shape}"
            )
        if not (np.all(np.isfinite(poses)) and np.all(np.isfinite(angles))):
            raise ValueError("poses and angles must be finite")
        planar = poses.shape[1] == 3
        if planar:
            poses = np.hstack([poses, np.zeros_like(poses)])
        ranges = np.empty((len(poses), len(angles)))
        cosines = np.empty_like(ranges) if incidence else np.empty((0, 0))
        c, s = np.cos(angles), np.sin(angles)
        traversal.cast_beams(poses, angles, c, s, float(range_max), planar, self._scene, ranges, cosines)
        return ranges, cosines


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
        return Raycaster(world if self.effects.heights else world.without_heights(), self.effects.floor)

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
        return corruption.corrupt(
            ranges.reshape(shape), cosines.reshape(shape), self.effects, limits, rng, haze
        )
