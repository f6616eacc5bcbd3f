"""Experiment 3 of Formsma's thesis: the same offices driven round twice, in one recording.

Between the drives the robot crosses a store filled with smoke, where its laser sees nothing for half a minute
and it falls from a ledge, which upsets the yaw of its INS. What was mapped before and after are two maps that
overlap from end to end, turned against each other: all that joins them is stitching. The smoke elsewhere is
thin. For the thesis this was the one case in which stitching did well.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from scenarios.catalogue import office
from scenarios.catalogue.building import Area, jittered, spread, start
from sim.record import Setup

CLOUDS, RADIUS, EXTINCTION = 5, (2.0, 4.0), (0.1, 0.4)
"""Number, radius [m] and extinction coefficient [1/m] of the clouds on the first drive."""
STORE = Area(6.8, -5.9, 13.1, -0.2)
"""A store beside the south corridor, filled with smoke."""
BLINDING = 60.0
"""Extinction coefficient there: hardly a beam comes as far as the laser's least range [1/m]."""
LEDGE = 0.35
"""What the robot falls from in the store [m]."""


def build(rng: np.random.Generator) -> Setup:
    """One office building and two drives through it: doors, furniture and exact routes drawn from ``rng``."""
    door = rng.uniform(9.0, 11.0)
    begin = np.array([office.MIDDLE, rng.uniform(4.0, 6.0)])
    west, east = STORE.x0 + 1.3, STORE.x1 - 1.3
    round_the_store = jittered([[west, -1.5], [west, -4.5], [east, -4.5], [east, -1.5]], 0.15, rng)
    blind = np.array([[door, 1.0], [door, -0.8], *round_the_store, [door, -0.8], [door, 1.0]])
    corner = [office.MIDDLE, office.MIDDLE]
    route = np.array([begin, corner, *office.round_trip(rng), *blind, *office.round_trip(rng)[1:]])
    clouds = [(p, rng.uniform(*RADIUS), rng.uniform(*EXTINCTION)) for p in spread(route, CLOUDS, rng)]
    world = office.world(route, clouds, rng, store_door=[door, 0.0, 0.0])
    filled = [[STORE.x0, STORE.y0], [STORE.x1, STORE.y0], [STORE.x1, STORE.y1], [STORE.x0, STORE.y1]]
    climb = blind[4] - blind[3]
    world = replace(
        world,
        smoke=world.smoke and world.smoke.with_polygon(filled, BLINDING),
        terrain=world.terrain.with_ramp(blind[3] + 0.2 * climb, blind[3] + 0.7 * climb, 1.2, LEDGE),
    )
    return Setup(world, start(route), route)
