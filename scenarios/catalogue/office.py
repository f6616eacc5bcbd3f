"""The offices of Experiments 2 and 3 in Formsma's thesis (IranOpen 2012 Semifinal), for two scenarios.

A ring of corridors, 50 m across, with offices on both sides; rows of tables and chairs, which a level laser
sees as dots; two hallways are blocked, and the way round leads through the open-plan offices beside them.
Smoke is everywhere. The laser reaches 20 m, and the ground is nearly level.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import numpy as np

from scenarios.catalogue.building import (
    PIECES,
    Area,
    closed_doors,
    distance,
    furnish,
    rectangle,
    walls,
    with_heaps,
)
from sim.driver import resample
from sim.floorplan import Prism, box
from sim.smoke import Smoke
from sim.terrain import Terrain
from sim.world import Debris, World
from slam.se2 import Array

LENGTH, DEPTH = 53.0, 47.0
"""Of the ring's outer walls [m]."""
CORRIDOR, OFFICE = 3.0, 6.0
"""Width of the corridors and depth of the offices on both sides [m]."""
CEILING = 2.5
CLEARANCE = 0.55
SHARE_CLOSED = 0.6
"""Of the doors that the route does not use."""
HEAPS = 16
OVERTURNED = 10
"""Loose things on the route's edge."""
HAZE = 0.02
"""Extinction coefficient [1/m] of the air where it is clearest."""
SOUTH_ROOM, NORTH_ROOM = Area(16.0, 3.0, 37.0, 9.0), Area(13.25, 47.0, 39.75, 53.0)
"""The open-plan offices."""
SOUTH_ENTRY, SOUTH_EXIT, NORTH_ENTRY, NORTH_EXIT = 18.0, 35.0, 37.0, 16.0
"""x of their doors in the order of the drive, counter-clockwise [m]."""
MIDDLE = 0.5 * CORRIDOR


@dataclass(frozen=True)
class Strip:
    """A row of ``count`` offices along a corridor whose wall is the side ``door_side`` of ``area``."""

    area: Area
    count: int
    door_side: Literal["south", "north", "west", "east"]

    def dividers(self) -> list[tuple[float, float, float, float]]:
        """Walls between the offices and at both ends of the row, as segments."""
        a = self.area
        if self.door_side in ("south", "north"):  # from west to east
            return [(x, a.y0, x, a.y1) for x in np.linspace(a.x0, a.x1, self.count + 1).tolist()]
        return [(a.x0, y, a.x1, y) for y in np.linspace(a.y0, a.y1, self.count + 1).tolist()]

    def offices(self) -> list[Area]:
        """The rooms of the row."""
        return [Area(low[0], low[1], high[2], high[3]) for low, high in pairwise(self.dividers())]

    def door(self, office: Area, rng: np.random.Generator) -> list[float]:
        """x, y and yaw of the wall of an office's door, anywhere near the middle of its wall."""
        shift = rng.uniform(-1.0, 1.0)
        (x, y), side = office.middle, self.door_side
        if side in ("south", "north"):
            return [x + shift, office.y0 if side == "south" else office.y1, 0.0]
        return [office.x0 if side == "west" else office.x1, y + shift, 0.5 * np.pi]


_DEEP = CORRIDOR + OFFICE
STRIPS = (
    Strip(Area(0.0, -OFFICE, LENGTH, 0.0), 8, "north"),
    Strip(Area(0.0, DEPTH, LENGTH, DEPTH + OFFICE), 8, "south"),
    Strip(Area(-OFFICE, 0.0, 0.0, DEPTH), 7, "east"),
    Strip(Area(LENGTH, 0.0, LENGTH + OFFICE, DEPTH), 7, "west"),
    Strip(Area(_DEEP, CORRIDOR, LENGTH - _DEEP, _DEEP), 5, "south"),
    Strip(Area(_DEEP, DEPTH - _DEEP, LENGTH - _DEEP, DEPTH - CORRIDOR), 5, "north"),
    Strip(Area(CORRIDOR, _DEEP, _DEEP, DEPTH - _DEEP), 4, "west"),
    Strip(Area(LENGTH - _DEEP, _DEEP, LENGTH - CORRIDOR, DEPTH - _DEEP), 4, "east"),
)
"""The offices outside and inside the ring."""


def round_trip(rng: np.random.Generator) -> list[Array]:
    """Waypoints of one drive round the ring, from its south-west corner back to it."""

    def along(x: float, y: float) -> Array:
        return np.array([x, y]) + rng.uniform(-0.6, 0.6, 2)

    def through(hall: Area, entry: float, leaving: float, y: float) -> list[Array]:
        """In by one door of an open-plan office, along its aisle, and out by the other."""
        before, after, step = hall.y0 - 1.4, hall.y0 + 1.2, 2.0 * np.sign(leaving - entry)
        aisle = [[x, y + rng.uniform(-0.3, 0.3)] for x in (entry + step, leaving - step)]
        way = [[entry, before], [entry, after], *aisle, [leaving, after], [leaving, before]]
        return [np.array(place) for place in way]

    return [
        along(7.0, MIDDLE),
        *through(SOUTH_ROOM, SOUTH_ENTRY, SOUTH_EXIT, 6.0),
        along(LENGTH - MIDDLE, MIDDLE),
        along(LENGTH - MIDDLE, DEPTH - MIDDLE),
        *through(NORTH_ROOM, NORTH_ENTRY, NORTH_EXIT, 50.0),
        along(MIDDLE, DEPTH - MIDDLE),
        along(MIDDLE, MIDDLE),
    ]


def world(
    route: Array,
    clouds: Sequence[tuple[Array, float, float]],
    rng: np.random.Generator,
    store_door: list[float] | None = None,
) -> World:
    """The building around a route: doors, furniture and what was overturned are drawn from ``rng``.

    ``clouds`` are (centre (2) m, radius m, extinction 1/m) of smoke thicker than the haze; ``store_door``
    (x, y, yaw of the wall) takes the place of the door of the office it belongs to.
    """
    doors, offices = _offices(rng, store_door)
    keep_clear = np.vstack([resample(route), doors[:, :2]])
    prisms = [
        *walls(_segments(), doors, 1.2),
        *closed_doors(doors, route, SHARE_CLOSED, rng, 1.2),
        *_barricade(26.5, MIDDLE, rng),
        *_barricade(26.5, DEPTH - MIDDLE, rng),
        *_open_plan(SOUTH_ROOM, keep_clear, rng),
        *_open_plan(NORTH_ROOM, keep_clear, rng),
    ]
    for office in offices:
        kinds = rng.permutation(["desk", "desk", "table", "cupboard", "chair"])[: rng.integers(2, 5)]
        prisms += furnish(office, kinds, keep_clear, CLEARANCE, rng)
    low, high = [-OFFICE, -OFFICE], [LENGTH + OFFICE, DEPTH + OFFICE]
    terrain = with_heaps(Terrain.level(low, high, 0.1), route, HEAPS, rng, (0.005, 0.02))
    corners = [[low[0], low[1]], [high[0], low[1]], high, [low[0], high[1]]]
    smoke = Smoke.clear(low, high, 0.2).with_polygon(corners, HAZE)
    for centre, radius, extinction in clouds:
        smoke = smoke.with_disc(centre, radius, extinction, edge=0.4 * radius)
    return World(tuple(prisms), terrain, CEILING, smoke, _overturned(route, rng))


def _offices(rng: np.random.Generator, store_door: list[float] | None) -> tuple[Array, list[Area]]:
    """Doors ``(K, 3)`` (x, y, yaw of the wall) of everything, and the single offices."""
    doors = [[x, SOUTH_ROOM.y0, 0.0] for x in (SOUTH_ENTRY, SOUTH_EXIT)]
    doors += [[x, NORTH_ROOM.y0, 0.0] for x in (NORTH_ENTRY, NORTH_EXIT)]
    offices = [(office, strip) for strip in STRIPS for office in strip.offices() if not _in_a_hall(office)]
    for office, strip in offices:
        door = strip.door(office, rng)
        doors.append(store_door if store_door and office.touches(store_door) else door)
    return np.array(doors), [office for office, _ in offices]


def _segments() -> list[tuple[float, float, float, float]]:
    """Outer walls, both walls of the ring, the courtyard's, and those between offices."""
    rings = [rectangle(d, d, LENGTH - d, DEPTH - d) for d in (-OFFICE, 0.0, CORRIDOR, _DEEP)]
    between = [wall for strip in STRIPS for wall in strip.dividers() if not _in_a_hall(Area(*wall), 0.5)]
    return [segment for segments in (*rings, between) for segment in segments]


def _in_a_hall(area: Area, margin: float = 0.0) -> bool:
    """True where the middle of an area lies in an open-plan office, ``margin`` m or more from its ends."""
    x, y = area.middle
    halls = (SOUTH_ROOM, NORTH_ROOM)
    return any(h.x0 + margin < x < h.x1 - margin and h.y0 < y < h.y1 for h in halls)


def _barricade(x: float, y: float, rng: np.random.Generator) -> list[Prism]:
    """Cupboards and tables piled up across a corridor that runs along x."""
    return [
        box(
            [x + rng.uniform(-0.5, 0.5), y + offset, rng.uniform(-0.4, 0.4)],
            0.8,
            0.9,
            z_hi=rng.uniform(0.8, 1.6),
        )
        for offset in np.arange(-1.05, 1.1, 0.7)
    ]


def _open_plan(hall: Area, keep_clear: Array, rng: np.random.Generator) -> list[Prism]:
    """Rows of tables with chairs along both long walls of a hall, with an aisle between them."""
    prisms: list[Prism] = []
    for x in np.arange(hall.x0 + 1.5, hall.x1 - 1.4, 2.4):
        for y, side in ((hall.y0 + 0.9, 1.0), (hall.y1 - 0.9, -1.0)):
            kind = rng.choice(["table", "desk", "cupboard"], p=[0.6, 0.3, 0.1])
            pose = np.array(
                [x + rng.uniform(-0.2, 0.2), y, rng.choice([0.0, np.pi]) + rng.uniform(-0.1, 0.1)]
            )
            chair = np.array([pose[0], y + 0.8 * side, rng.uniform(-np.pi, np.pi)])
            for name, at in ((kind, pose), ("chair", chair)):
                if distance(at, PIECES[name].size, keep_clear) > CLEARANCE:
                    prisms += PIECES[name].make(at)
    return prisms


def _overturned(route: Array, rng: np.random.Generator) -> tuple[Debris, ...]:
    """Chairs and boxes beside the route; some near enough for the robot to push them aside."""
    path = resample(route)
    debris = []
    for at in rng.choice(np.arange(100, len(path) - 100), OVERTURNED, replace=False):
        ahead = path[at + 1] - path[at]
        left = np.array([-ahead[1], ahead[0]]) / np.hypot(*ahead)
        x, y = path[at] + rng.choice([-1.0, 1.0]) * rng.uniform(0.3, 0.9) * left
        block = box(
            [x, y, rng.uniform(-np.pi, np.pi)], rng.uniform(0.2, 0.4), 0.2, z_hi=rng.uniform(0.25, 0.6)
        )
        debris.append(Debris(block, mass=rng.uniform(1.0, 4.0)))
    return tuple(debris)
