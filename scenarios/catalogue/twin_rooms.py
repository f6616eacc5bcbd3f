"""Rows of identical rooms, to the last piece of furniture, on both sides of a corridor.

A scan from one room fits every other room: a stitch that looks perfect may be four metres off. The INS is
consistent: its position drifts with its yaw. At the far end of the corridor the robot falls from a ledge,
which turns that yaw by some twelve degrees: on the way back the INS is in the wrong room. What a method must
show is that it accepts no false stitch.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from scenarios.catalogue.building import Area, furnish, jittered, start, walls, with_heaps, with_sills
from sim.driver import resample
from sim.record import Setup
from sim.terrain import Terrain
from sim.world import World
from slam import se2
from slam.se2 import Array

ROOMS = 9
"""On each side of the corridor."""
WIDTH, DEPTH, CORRIDOR = 4.0, 4.5, 2.0
"""Of a room along and across the corridor, and of the corridor [m]."""
DOOR_X = 1.2
"""Middle of a room's door, from its west wall [m]."""
LEDGE, SLOPE = 0.3, 1.8
"""Height and length of the ramp that ends in the ledge, on the south side of the corridor [m]."""
TURN = 6.0
"""Length of the corridor's end, where no room is entered [m]."""
CEILING = 2.5
CLEARANCE = 0.42
HEAPS = 10
SPREAD = 0.4
"""How far the spot that is driven to in a room may be off its middle [m]."""
VISITS = 7
"""Rooms that the route enters, on the way out and on the way back."""


def build(rng: np.random.Generator) -> Setup:
    """One building: the furniture that all rooms share, rubble, and the rooms on the route from ``rng``."""
    length, across = ROOMS * WIDTH, 2.0 * DEPTH + CORRIDOR
    south = [[WIDTH * k, 0.0, 0.0] for k in range(ROOMS)]
    north = [[WIDTH * (k + 1), across, np.pi] for k in range(ROOMS)]
    anchors = np.array([*south, *north])  # frames of the rooms, their door in the wall at y = DEPTH
    doors = np.array([se2.compose(anchor, [DOOR_X, DEPTH, 0.0]) for anchor in anchors])
    route = draw_route(anchors, rng)
    segments = [(0.0, y, length, y) for y in (0.0, DEPTH, DEPTH + CORRIDOR, across)]
    segments += [(x, 0.0, x, across) for x in (0.0, length)]
    segments += [(x, y, x, y + DEPTH) for x in WIDTH * np.arange(1, ROOMS) for y in (0.0, DEPTH + CORRIDOR)]
    prisms = walls(segments, doors)
    step, middle = [DOOR_X, DEPTH - 0.8], 0.5 * WIDTH
    entered = [[DOOR_X, DEPTH], step, [middle - SPREAD, 0.5 * DEPTH], [middle + SPREAD, 0.5 * DEPTH], step]
    kinds = rng.permutation(["bed", "desk", "cupboard", "table", "trolley", "chair"])
    pieces = furnish(Area(0.0, 0.0, WIDTH, DEPTH), kinds, resample(entered), CLEARANCE, rng)
    for anchor in anchors:
        prisms += [replace(p, footprint=se2.transform(anchor, p.footprint)) for p in pieces]
    terrain = Terrain.level([-0.5, -0.5], [length + 0.5, across + 0.5])
    terrain = with_heaps(with_sills(terrain, doors, rng), route, HEAPS, rng)
    ledge = np.array([length - 2.0, DEPTH + 0.5 * CORRIDOR - 0.45])
    terrain = terrain.with_ramp(ledge - [SLOPE, 0.0], ledge, 0.7, LEDGE)
    return Setup(World(tuple(prisms), terrain, CEILING), start(route), route)


def draw_route(anchors: Array, rng: np.random.Generator) -> Array:
    """Waypoints ``(K, 2)`` m: out and back along the corridor, into rooms on both ways, one of them twice."""
    y, length = DEPTH + 0.5 * CORRIDOR, ROOMS * WIDTH
    doors = se2.transform(anchors, np.array([[DOOR_X, DEPTH]]))[:, 0]
    rooms = rng.permutation(np.flatnonzero(doors[:, 0] < length - TURN))[: VISITS - 1]
    out, back = rooms[: VISITS // 2], rooms[VISITS // 2 - 1 :]
    waypoints = [np.array([0.8, y])]
    for k in sorted(out, key=lambda k: anchors[k, 0]):
        waypoints += _visit(anchors[k], y, rng)
    turn = np.array([[TURN, 0.0], [4.5, -0.45], [1.2, -0.45], [1.2, 0.5], [4.5, 0.5], [TURN, 0.0]])
    waypoints += list(np.array([length, y]) + turn * [-1.0, 1.0])
    for k in sorted(back, key=lambda k: -anchors[k, 0]):
        waypoints += _visit(anchors[k], y, rng)
    return jittered([*waypoints, np.array([1.0, y])], 0.08, rng)


def _visit(anchor: Array, corridor: float, rng: np.random.Generator) -> list[Array]:
    """From the corridor in by the door, to the middle of the room, and out again."""
    inside, spot = [DOOR_X, DEPTH - 0.8], [0.5 * WIDTH + rng.uniform(-SPREAD, SPREAD), 0.5 * DEPTH]
    within = [se2.transform(anchor, np.array([p]))[0] for p in (inside, spot, inside)]
    outside = np.array([within[0][0], corridor])
    return [outside, *within, outside]
