"""What the robot can run into, as physics seen from above: solids, debris and people."""

from __future__ import annotations

import pymunk

from sim.floorplan import Prism
from sim.movers import Debris, Walker
from sim.world import World

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
