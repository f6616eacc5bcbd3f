"""Somebody's own building, from the map that their robot made of it: lose your place at home.

The walls are as high as rooms are. A map says nothing of the ground: rubble lies on the route, which leads to
far places, home and round again, so that what was torn can be stitched.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from scenarios.catalogue.building import with_heaps
from sim.driver import DriverConfig, resample
from sim.floorplan import WALL_HEIGHT, walls_of_map
from sim.record import Setup
from sim.robot import RobotConfig
from sim.route import NoRouteError, plan
from sim.terrain import Terrain
from sim.world import World
from slam.cli import InputError, Pose
from slam.formats import FormatError, ros_map
from slam.se2 import Array

METRES_PER_HEAP = 15.0
SECONDS_PER_METRE = 5.0
"""Time the driver gets, pauses included."""


@dataclass(frozen=True)
class MappedBuilding:
    """The building on a ROS map, driven through from ``start`` (x, y, yaw), or from anywhere if None."""

    path: Path
    start: Pose | None = None

    @property
    def name(self) -> str:
        """Name of the map."""
        return self.path.stem

    def build(self, rng: np.random.Generator) -> Setup:
        """Draw route and rubble. Raises `InputError` for a map that cannot be read or driven through."""
        robot = RobotConfig()
        try:
            grid = ros_map.read(self.path)
        except FormatError as error:
            raise InputError(str(error)) from error
        try:
            route = plan(
                grid, 0.5 * float(np.hypot(robot.length, robot.width)), rng, self.start and self.start[:2]
            )
        except NoRouteError as error:
            raise InputError(f"{self.path}: {error}") from error
        path = resample(route)
        length = 0.05 * len(path)
        level = Terrain.level(path.min(axis=0) - 2.0, path.max(axis=0) + 2.0)
        terrain = with_heaps(level, route, round(length / METRES_PER_HEAP), rng, again=True)
        world = World(tuple(walls_of_map(grid)), terrain, WALL_HEIGHT)
        start = self.start or (*path[0].tolist(), _heading(path))
        driver = DriverConfig(time_limit=max(DriverConfig.time_limit, SECONDS_PER_METRE * length))
        return Setup(world, start, route, robot=robot, driver=driver)


def _heading(path: Array, ahead: int = 10) -> float:
    dx, dy = path[min(ahead, len(path) - 1)] - path[0]
    return float(np.arctan2(dy, dx))
