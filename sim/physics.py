"""What the robot can run into, as physics seen from above: solids, debris, and people on their way."""

from __future__ import annotations

import math
from bisect import bisect_right

import numpy as np
import pymunk

from sim.floorplan import Prism
from sim.world import Debris, Person, World

GRAVITY = 9.81
SURFACE_FRICTION = 0.3
"""Between the sides of solids that touch."""
STRIDE = 5
"""Steps of physics between two decisions of a walker, who keeps on straight in between."""


class PhysicsWorld:
    """A pymunk space without gravity with every solid that reaches between ``z_lo`` and ``z_hi`` m."""

    def __init__(self, world: World, z_lo: float, z_hi: float) -> None:
        self.space = pymunk.Space()  # never let bodies sleep: to free one with joints crashes pymunk 7
        self.space.collision_slop = 0.005
        self._z_lo, self._z_hi = z_lo, z_hi
        for prism in world.prisms:
            self._add_shape(prism, self.space.static_body)
        self._debris = [self._add_debris(debris) for debris in world.debris]
        self._walkers = [Walker(person) for person in world.people]
        self._people = [self._add_person(walker) for walker in self._walkers]
        self._steps = 0

    @property
    def movers(self) -> list[tuple[float, float, float]]:
        """Poses of the debris, then of the people: x, y m and yaw rad."""
        return [(*body.position, body.angle) for body in (*self._debris, *self._people)]

    def step(self, robot: tuple[float, float], dt: float) -> None:
        """Let people walk, given where the ``robot`` (x, y) is, and advance all bodies by ``dt`` s."""
        if self._steps % STRIDE == 0:
            self._walk(robot, STRIDE * dt)
        self._steps += 1
        self.space.step(dt)

    def _walk(self, robot: tuple[float, float], dt: float) -> None:
        for walker, body in zip(self._walkers, self._people, strict=True):
            walker.step(robot, dt)
            (x, y), at = walker.place, body.position
            body.velocity = (x - at.x) / dt, (y - at.y) / dt
            body.angle = walker.heading

    def _add_shape(self, prism: Prism, body: pymunk.Body) -> None:
        if prism.z_hi > self._z_lo and prism.z_lo < self._z_hi:
            shape = pymunk.Poly(body, [tuple(corner) for corner in prism.footprint])
            shape.friction = SURFACE_FRICTION
            self.space.add(shape)

    def _add_debris(self, debris: Debris) -> pymunk.Body:
        """A loose body that the ground holds back with its friction, in sliding and in turning."""
        corners = [tuple(corner) for corner in debris.shape.footprint]
        body = pymunk.Body(debris.mass, pymunk.moment_for_poly(debris.mass, corners))
        body.position = tuple(debris.centre)
        self.space.add(body)
        self._add_shape(debris.shape, body)
        ground = self.space.static_body
        sliding = pymunk.PivotJoint(ground, body, body.position, (0.0, 0.0))
        turning = pymunk.GearJoint(ground, body, 0.0, 1.0)
        limit = debris.friction * debris.mass * GRAVITY
        arm = (body.moment / debris.mass) ** 0.5  # where the friction acts, on average
        for joint, most in ((sliding, limit), (turning, limit * arm)):
            joint.max_bias, joint.max_force = 0.0, most  # holds against motion, never pulls back
            self.space.add(joint)
        return body

    def _add_person(self, walker: Walker) -> pymunk.Body:
        body = pymunk.Body(body_type=pymunk.Body.KINEMATIC)
        body.position = walker.place
        self.space.add(body)
        self._add_shape(walker.person.shape, body)
        return body


class Walker:
    """A person on the way: how far round the loop, and in which sense."""

    def __init__(self, person: Person) -> None:
        self.person = person
        closed = np.vstack([person.loop, person.loop[:1]])
        legs = np.diff(closed, axis=0)
        length = np.hypot(legs[:, 0], legs[:, 1])
        self._corners: list[tuple[float, float]] = [(x, y) for x, y in closed.tolist()]
        self._legs: list[tuple[float, float]] = [(x, y) for x, y in (legs / length[:, None]).tolist()]
        self._begins: list[float] = np.concatenate([[0.0], np.cumsum(length)[:-1]]).tolist()
        self._length = float(length.sum())
        self._along = (person.start % 1.0) * self._length
        self._sense = 1.0

    @property
    def place(self) -> tuple[float, float]:
        """Where the person is now, x and y m."""
        return self._at(self._along)

    @property
    def heading(self) -> float:
        """Direction of walking [rad]."""
        ex, ey = self._legs[self._leg(self._along)]
        return math.atan2(self._sense * ey, self._sense * ex)

    def step(self, robot: tuple[float, float], dt: float) -> None:
        """Walk on for ``dt`` s; close to the ``robot`` (x, y) only away from it, else stand."""
        stride = self.person.speed * dt
        gap = _distance(self.place, robot)
        for sense in (self._sense, -self._sense):
            along = (self._along + sense * stride) % self._length
            if gap > self.person.keep_off or _distance(self._at(along), robot) >= gap:
                self._along, self._sense = along, sense
                return

    def _leg(self, along: float) -> int:
        return bisect_right(self._begins, along) - 1

    def _at(self, along: float) -> tuple[float, float]:
        k = self._leg(along)
        (x, y), (ex, ey), on = self._corners[k], self._legs[k], along - self._begins[k]
        return x + on * ex, y + on * ey


def _distance(a: tuple[float, float], b: tuple[float, float]) -> float:
    return math.hypot(a[0] - b[0], a[1] - b[1])
