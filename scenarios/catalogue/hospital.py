"""A hospital in the spirit of IranOpen 2012 Preliminary 2, the world of Experiment 1 in Formsma's thesis.

Two long corridors joined at both ends, rooms on either side, beds and desks that a level laser hardly sees.
Door sills and rubble tilt the robot: its laser then draws the floor as if it were a wall. In the first room
it falls from a ledge, which upsets the yaw of its INS as the fall in the thesis's log does; in the hall at
the east end the walls are out of range. A matcher that starts at the absolute INS pose then loses its place
again and again: in the hall for want of anything to match, in the corridors because its map, drawn askew,
drifts away from the INS. The route returns to both corridors and the hall, so that what was torn can be
stitched.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from scenarios.catalogue.building import Area, closed_doors, furnish, jittered, walls, with_heaps, with_sills
from sim.driver import resample
from sim.floorplan import Prism
from sim.record import Setup
from sim.terrain import Terrain
from sim.world import World
from slam.se2 import Array

Spot = tuple[float, float]

LENGTH = 30.0
HALL = 8.8
"""How far the hall at the east end, open to both corridors, reaches beyond them [m]."""
SOUTH, CORRIDOR_A, CORRIDOR_B, NORTH = (0.0, 5.0), (5.0, 7.0), (12.5, 14.5), (14.5, 19.5)
MIDDLE = (CORRIDOR_A[1], CORRIDOR_B[0])
CROSS = 2.0
"""Width of the short corridor that joins the long ones at their west end [m]."""
CEILING = 2.5
CLEARANCE = 0.42
"""Furniture keeps this far from the route [m]."""
SHARE_CLOSED = 0.5
"""Of the doors that the route does not use."""
HEAPS = 4
"""Of rubble, on the route."""
LEDGE = 0.3
"""What the robot falls from in the first room: the shock upsets the INS [m]."""


@dataclass(frozen=True)
class Room:
    """A room between ``x0`` and ``x1`` and between walls at ``y``; ``doors``: x of the door by wall [m]."""

    x0: float
    x1: float
    y: tuple[float, float]
    doors: dict[float, float]

    @property
    def centre(self) -> tuple[float, float]:
        """Middle of the room."""
        return 0.5 * (self.x0 + self.x1), 0.5 * (self.y[0] + self.y[1])

    def entry(self, corridor: float) -> tuple[list[Spot], float, float]:
        """Outside and inside of the door nearest to a corridor, y of its wall, and the sign of y inwards."""
        wall, x = min(self.doors.items(), key=lambda door: abs(door[0] - corridor))
        inwards = float(np.sign(wall - corridor))
        return [(x, corridor), (x, wall + 0.7 * inwards)], wall, inwards


class Rooms(NamedTuple):
    """The rooms from west to east, on the three sides of the corridors."""

    south: tuple[Room, ...]
    middle: tuple[Room, ...]
    north: tuple[Room, ...]

    @property
    def all(self) -> tuple[Room, ...]:
        """Every room."""
        return self.south + self.middle + self.north


def build(rng: np.random.Generator) -> Setup:
    """One hospital: doors, furniture, hazards and the exact route drawn from ``rng``."""
    rooms = draw_rooms(rng)
    route = draw_route(rooms, rng)
    doors = np.array([[x, y, 0.0] for room in rooms.all for y, x in room.doors.items()])
    shut = closed_doors(doors, route, SHARE_CLOSED, rng)
    keep_clear = np.vstack([resample(route), doors[:, :2]])
    prisms = [*walls(_segments(rooms), doors), *shut, *_furniture(rooms, keep_clear, rng)]
    level = Terrain.level([-0.5, -0.5], [LENGTH + HALL + 0.5, NORTH[1] + 0.5])
    terrain = with_heaps(with_sills(level, doors, rng), route, HEAPS, rng)
    first, second = route[3], route[4]  # the two spots of the first room
    ledge = first + 0.1 * (second - first), first + 0.6 * (second - first)
    world = World(tuple(prisms), terrain.with_ramp(*ledge, 1.0, LEDGE), CEILING)
    return Setup(world, (*route[0].tolist(), 0.0), route)


def draw_rooms(rng: np.random.Generator) -> Rooms:
    """Seventeen rooms, each with a door to the corridor beside it; one in the middle leads from A to B."""

    def row(x: Array, y: tuple[float, float], door_walls: list[list[float]]) -> tuple[Room, ...]:
        return tuple(
            Room(a, b, y, {w: float(0.5 * (a + b) + rng.uniform(-1.2, 1.2)) for w in walls})
            for a, b, walls in zip(x[:-1], x[1:], door_walls, strict=True)
        )

    outer, inner = np.linspace(0.0, LENGTH, 7), np.linspace(CROSS, LENGTH, 6)
    to_a, to_b = MIDDLE
    return Rooms(
        row(outer, SOUTH, [[CORRIDOR_A[0]]] * 6),
        row(inner, MIDDLE, [[to_a], [to_b], [to_a, to_b], [to_b], [to_a]]),
        row(outer, NORTH, [[CORRIDOR_B[1]]] * 6),
    )


def draw_route(rooms: Rooms, rng: np.random.Generator) -> Array:
    """Waypoints ``(K, 2)`` m: two loops that share the hall; six rooms visited, one passed through."""
    a, b = 0.5 * sum(CORRIDOR_A), 0.5 * sum(CORRIDOR_B)
    west = [rooms.south[0], rooms.south[1], rooms.middle[0]]
    legs = [
        [(rng.uniform(11.0, 13.0), a)],
        _visit(rooms.south[rng.choice([3, 4])], a, rng, apart=1.3),
        _cross_hall(a, b, rng),
        _glance(rooms.north[rng.choice([4, 5])], b, rng),
        _glance(rooms.middle[3], b, rng),
        _visit(rooms.north[rng.choice([1, 2, 3])], b, rng),
        _glance(rooms.north[0], b, rng),
        [(0.5 * CROSS, b), (0.5 * CROSS, a)],
        _glance(west[rng.choice(3)], a, rng),
        _pass(rooms.middle[2], a, b),
        _cross_hall(b, a, rng),
        [(rng.uniform(25.0, 28.0), a)],
    ]
    return jittered([spot for leg in legs for spot in leg], 0.08, rng)


def _cross_hall(corridor: float, other: float, rng: np.random.Generator) -> list[Spot]:
    """From one corridor to the other through the middle of the hall."""
    x, door = LENGTH + 0.5 * HALL + rng.uniform(-0.3, 0.3), LENGTH + 0.5
    inwards = np.sign(other - corridor)
    return [(door, corridor), (x, corridor + 1.5 * inwards), (x, other - 1.5 * inwards), (door, other)]


def _visit(room: Room, corridor: float, rng: np.random.Generator, apart: float = 0.8) -> list[Spot]:
    """In by the door, to two spots of the room, and out again."""
    way, _, inwards = room.entry(corridor)
    x, y = room.centre
    spots = [
        (x + side * rng.uniform(0.7, 1.3) * apart, y + inwards * rng.uniform(-0.4, 1.0))
        for side in rng.permutation([-1.0, 1.0])
    ]
    return [*way, *spots, *reversed(way)]


def _glance(room: Room, corridor: float, rng: np.random.Generator) -> list[Spot]:
    """In by the door, to the middle of the room, and out again."""
    way, wall, inwards = room.entry(corridor)
    spot = (room.centre[0] + rng.uniform(-0.6, 0.6), wall + inwards * rng.uniform(1.6, 2.2))
    return [*way, spot, *reversed(way)]


def _pass(room: Room, corridor: float, other: float) -> list[Spot]:
    """From one corridor to the other through a room with two doors."""
    (near, entry), (far, leaving) = sorted(room.doors.items(), key=lambda door: abs(door[0] - corridor))
    inside = 0.8 * np.sign(other - corridor)
    return [(entry, corridor), (entry, near + inside), (leaving, far - inside), (leaving, other)]


def _segments(rooms: Rooms) -> list[tuple[float, float, float, float]]:
    """The walls, as segments."""
    far, (lower, upper) = LENGTH + HALL, (CORRIDOR_A[0], CORRIDOR_B[1])
    upright = [
        (0.0, SOUTH[0], NORTH[1]),
        *((LENGTH, *y) for y in (SOUTH, MIDDLE, NORTH)),
        (far, lower, upper),
    ]
    upright += [(room.x0, *room.y) for room in (*rooms.south[1:], *rooms.middle, *rooms.north[1:])]
    across = [(SOUTH[0], 0.0, LENGTH), (lower, 0.0, far), *((y, CROSS, LENGTH) for y in MIDDLE)]
    across += [(upper, 0.0, far), (NORTH[1], 0.0, LENGTH)]
    return [(x, y0, x, y1) for x, y0, y1 in upright] + [(x0, y, x1, y) for y, x0, x1 in across]


def _furniture(rooms: Rooms, keep_clear: Array, rng: np.random.Generator) -> list[Prism]:
    """Beds, desks, cupboards and crates in the rooms, crates and trolleys in the corridors."""
    placed: list[Prism] = []
    for room in rooms.all:
        kinds = rng.permutation(["bed", "bed", "desk", "cupboard", "crate"])[: rng.integers(3, 6)]
        placed += furnish(Area(room.x0, room.y[0], room.x1, room.y[1]), kinds, keep_clear, CLEARANCE, rng)
    for y in (CORRIDOR_A, CORRIDOR_B):
        kinds = rng.choice(["crate", "trolley"], 4, p=[0.5, 0.5])
        placed += furnish(Area(CROSS, y[0], LENGTH, y[1]), kinds, keep_clear, CLEARANCE, rng)
    return placed
