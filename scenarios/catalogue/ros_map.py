"""Somebody's own building, from the map that their robot made of it: lose your place at home.

The walls are as high as rooms are. A map says nothing of the ground: rubble lies on the route, which leads to
far places, home and round again, so that what was torn can be stitched. Only free cells are driven over: what
is unknown may be outdoors, or a hole.
"""

from __future__ import annotations

import contextlib
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
from scipy.ndimage import label

from scenarios.catalogue.building import with_heaps
from sim.driver import DriverConfig, resample
from sim.floorplan import WALL_HEIGHT, walls_of_map
from sim.record import Setup
from sim.robot import RobotConfig
from sim.route import NoRouteError, plan
from sim.terrain import Terrain
from sim.world import World
from slam import se2
from slam.cli import InputError, Pose
from slam.formats import FormatError, ros_map
from slam.formats.ros_map import RosMap
from slam.mapping.occupancy import Grid
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

    @cached_property
    def map(self) -> RosMap:
        """The map as it is read. Raises `InputError` for one that cannot be read."""
        try:
            return ros_map.read_map(self.path)
        except FormatError as error:
            raise InputError(str(error)) from error

    def build(self, rng: np.random.Generator) -> Setup:
        """Draw route and rubble. Raises `InputError` for a map that cannot be read or driven through."""
        robot = RobotConfig()
        T_map_upright = np.array([0.0, 0.0, self.map.T_map_grid[2]])  # in whose axes the cells lie
        grid = replace(self.map.grid, origin=se2.between(T_map_upright, self.map.T_map_grid)[:2])
        start = self.start and se2.between(T_map_upright, np.array(self.start))
        try:
            upright = self._route(grid, 0.5 * float(np.hypot(robot.length, robot.width)), rng, start)
        except NoRouteError as error:
            axes = " (in the axes of the image)" if T_map_upright[2] else ""
            raise InputError(f"{self.path}: {error}{axes}") from error
        route = se2.transform(T_map_upright, upright)
        path = resample(route)
        length = 0.05 * len(path)
        level = Terrain.level(path.min(axis=0) - 2.0, path.max(axis=0) + 2.0)
        terrain = with_heaps(level, route, round(length / METRES_PER_HEAP), rng, again=True)
        world = World(tuple(walls_of_map(grid, yaw=T_map_upright[2])), terrain, WALL_HEIGHT)
        begin = self.start or (*path[0].tolist(), _heading(path))
        driver = DriverConfig(time_limit=max(DriverConfig.time_limit, SECONDS_PER_METRE * length))
        return Setup(world, begin, route, robot=robot, driver=driver)

    def _route(self, grid: Grid, radius: float, rng: np.random.Generator, start: Array | None) -> Array:
        """Waypoints ``(K, 2)`` m, indoors where the map does not tell outdoors from free."""
        place = None if start is None else (float(start[0]), float(start[1]))
        if not self.map.states_unknown:
            with contextlib.suppress(NoRouteError):
                return plan(replace(grid, free=enclosed(grid.free)), radius, rng, place)
        return plan(grid, radius, rng, place)


def enclosed(free: np.ndarray) -> np.ndarray:
    """Those of the free cells ``(H, W)`` from which no way over free cells leads to the edge of the map."""
    regions, count = label(free)
    edge = np.concatenate([regions[0], regions[-1], regions[:, 0], regions[:, -1]])
    return np.isin(regions, np.setdiff1d(np.arange(1, count + 1), edge))


def _heading(path: Array, ahead: int = 10) -> float:
    dx, dy = path[min(ahead, len(path) - 1)] - path[0]
    return float(np.arctan2(dy, dx))
