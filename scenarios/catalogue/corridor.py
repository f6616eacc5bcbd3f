"""Fifty metres between two bare walls: degenerate along the axis.

In the corridor the laser sees two parallel walls and nothing else, so no scan says how far the robot has
come; there is no INS, and the encoders slip. A matcher should say so: its covariance must be long along the
corridor, and its position there no better than the encoders'. Only the halls at both ends, each driven
round, hold the map together. A method that believes its matches shortens the corridor.
"""

from __future__ import annotations

import numpy as np

from scenarios.catalogue.building import Area, furnish, jittered, start, walls, with_heaps
from sim.driver import resample
from sim.floorplan import column
from sim.record import Setup
from sim.terrain import Terrain
from sim.world import World

LENGTH, WIDTH = 50.0, 2.4
"""Of the corridor [m]."""
HALL = 8.0
"""Side of the square halls at its ends [m]."""
CEILING = 2.5
CLEARANCE = 0.45
HEAPS = 6
LOW, HIGH = 0.5 * (HALL - WIDTH), 0.5 * (HALL + WIDTH)
"""y of the corridor's walls [m]."""


def build(rng: np.random.Generator) -> Setup:
    """One corridor: what stands in the halls, rubble and the exact route drawn from ``rng``."""
    far, end, y = HALL + LENGTH, 2.0 * HALL + LENGTH, 0.5 * HALL
    east = [[far - 0.5, y], [far + 2.0, 2.0], [end - 2.0, 2.0], [end - 2.0, 6.0], [far + 2.0, 6.0]]
    west = [[HALL + 0.5, y], [6.0, 6.0], [2.0, 6.0], [2.0, 2.0], [6.0, 2.0]]
    waypoints = [west[3], west[4], west[0], *east, east[0], *west, west[0], [HALL + rng.uniform(4.0, 8.0), y]]
    route = jittered(waypoints, 0.2, rng)
    path = resample(route)
    halls = [
        *((x, 0.0, x, HALL) for x in (0.0, end)),
        *((x, y, x + HALL, y) for x in (0.0, far) for y in (0.0, HALL)),
        *((x, a, x, b) for x in (HALL, far) for a, b in ((0.0, LOW), (HIGH, HALL))),
    ]
    prisms = walls([*halls, (HALL, LOW, far, LOW), (HALL, HIGH, far, HIGH)], [])
    for x in (0.0, far):
        middle = np.array([x + 0.5 * HALL, y]) + rng.uniform(-0.5, 0.5, 2)
        prisms.append(column(middle, rng.uniform(0.25, 0.5)))
        kinds = rng.choice(["desk", "table", "cupboard", "trolley", "chair"], 8)
        prisms += furnish(Area(x, 0.0, x + HALL, HALL), kinds, path, CLEARANCE, rng)
    terrain = with_heaps(Terrain.level([-0.5, -0.5], [end + 0.5, HALL + 0.5]), route, HEAPS, rng)
    return Setup(World(tuple(prisms), terrain, CEILING), start(route), route)
