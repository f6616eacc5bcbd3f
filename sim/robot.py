"""A skid-steered robot: pymunk moves and collides it in the plane, the ground under it tilts it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pymunk

from sim.physics import GRAVITY, SURFACE_FRICTION, PhysicsWorld
from sim.terrain_kernels import HeightField, footprint_plane, height_at
from sim.world import World

FULL_SHAKE = 0.3
"""Speed [m/s] from which rubble shakes the robot in full; at rest it does not."""


@dataclass(frozen=True)
class RobotConfig:
    """Body and tracks; the defaults are those of USARSim's Kenaf."""

    length: float = 0.40
    """Of the body [m]."""
    width: float = 0.22
    """Of the body, and between the tracks [m]."""
    height: float = 0.45
    """Solids that begin above this do not stop the robot [m]."""
    step_height: float = 0.08
    """Solids that end below this do not stop the robot [m]."""
    mass: float = 24.0
    """kg."""
    friction: float = 0.8
    """Coulomb's coefficient of the tracks along the body."""
    lateral_friction: float = 0.6
    """The same across."""
    grip: float = 0.02
    """Time [s] in which a track takes up its commanded speed."""
    skid_ratio: float = 1.5
    """How many times slower the body turns than its track speeds say."""
    tilt_rate: float = 12.0
    """Natural frequency [rad/s] with which roll and pitch follow the ground."""
    tilt_damping: float = 0.4
    """Damping ratio of that; 1 is critical."""

    def track_speeds(self, speed: float, turn_rate: float) -> tuple[float, float]:
        """Left and right track speeds m/s that give this speed m/s and turn rate rad/s on level ground."""
        half = 0.5 * self.width * self.skid_ratio * turn_rate
        return speed - half, speed + half


class Tilt:
    """One angle that follows a target as a damped second-order system, shaken by white noise."""

    def __init__(self, rate: float, damping: float, angle: float) -> None:
        self.angle, self.velocity = angle, 0.0
        self._rate, self._damping = rate, damping

    def step(self, target: float, shake: float, dt: float) -> None:
        """Advance by ``dt`` s; ``shake`` is a normal draw times the stationary deviation [rad] it causes."""
        gain = 2.0 * np.sqrt(self._damping / (self._rate * dt))
        pull = self._rate**2 * (target + gain * shake - self.angle)
        self.velocity += dt * (pull - 2.0 * self._damping * self._rate * self.velocity)
        self.angle += dt * self.velocity


class Robot:
    """The robot in its world. ``step`` moves it; the properties say where it is."""

    def __init__(self, world: World, pose: tuple[float, float, float], config: RobotConfig) -> None:
        self.config = config
        self._ground: HeightField = world.terrain.field
        self._roughness: HeightField = world.terrain.roughness_field
        self._physics = PhysicsWorld(world, config.step_height, config.height)
        inertia = pymunk.moment_for_box(config.mass, (config.length, config.width))
        self._body = pymunk.Body(config.mass, inertia)
        self._body.position = pose[:2]
        self._body.angle = pose[2]
        shape = pymunk.Poly.create_box(self._body, (config.length, config.width))
        shape.friction = SURFACE_FRICTION
        shape.collision_type = 1
        space = self._physics.space
        space.add(self._body, shape)
        space.on_collision(1, None, post_solve=self._feel)
        self.impulse = 0.0
        self._falling = 0.0
        self.height, forward, left = self._plane()
        self._roll = Tilt(config.tilt_rate, config.tilt_damping, float(np.arctan(left)))
        self._pitch = Tilt(config.tilt_rate, config.tilt_damping, -float(np.arctan(forward)))

    @property
    def pose(self) -> tuple[float, float, float]:
        """x, y [m] and yaw [rad], not wrapped."""
        x, y = self._body.position
        return x, y, self._body.angle

    @property
    def state(self) -> tuple[float, float, float, float, float, float]:
        """x, y, yaw, roll, pitch [rad] and height of the ground under it [m]."""
        return *self.pose, self._roll.angle, self._pitch.angle, self.height

    @property
    def movers(self) -> list[tuple[float, float, float]]:
        """Poses x, y, yaw of the debris, then of the people."""
        return self._physics.movers

    @property
    def roughness(self) -> float:
        """Tilt [rad] that the rubble under the robot adds."""
        return height_at(*self._body.position, self._roughness)

    def step(self, left: float, right: float, dt: float, rng: np.random.Generator) -> None:
        """Advance by ``dt`` s with these track speeds [m/s].

        Afterwards ``impulse`` is the largest [N s] of the step, of a collision or a landing, and ``height``
        the robot's: the ground's mean under its footprint, or above it while it falls.
        """
        height, forward, sideways = self._plane()
        self._push(left, right, forward, sideways)
        self.impulse = 0.0
        self._physics.step(self._body.position, dt)
        self._fall(height, dt)
        moving = min(1.0, self._body.velocity.length / FULL_SHAKE)
        shake_roll, shake_pitch = rng.standard_normal(2) * self.roughness * moving
        self._roll.step(float(np.arctan(sideways)), shake_roll, dt)
        self._pitch.step(-float(np.arctan(forward)), shake_pitch, dt)

    def _plane(self) -> tuple[float, float, float]:
        return footprint_plane(*self.pose, self.config.length, self.config.width, self._ground)

    def _fall(self, ground: float, dt: float) -> None:
        """Follow the ground upwards at once, downwards no faster than gravity has it."""
        self._falling += GRAVITY * dt
        if self.height - self._falling * dt > ground:
            self.height -= self._falling * dt
            return
        if self.height > ground:
            self.impulse = max(self.impulse, self.config.mass * self._falling)
        self.height, self._falling = ground, 0.0

    def _push(self, left: float, right: float, forward: float, sideways: float) -> None:
        """Forces of tracks, sideways friction, scrubbing and slope on the body, for one step."""
        c, body = self.config, self._body
        stiffness = 0.5 * c.mass / c.grip
        velocity = body.velocity.rotated(-body.angle)
        weight = c.mass * GRAVITY
        half = 0.5 * c.width
        spin = half * body.angular_velocity
        slips, limit = (left - velocity.x + spin, right - velocity.x - spin), 0.5 * c.friction * weight
        pull_left, pull_right = (min(max(stiffness * slip, -limit), limit) for slip in slips)
        limit = c.lateral_friction * weight
        side = min(max(-velocity.y * c.mass / c.grip, -limit), limit)
        scrub = 2.0 * (c.skid_ratio - 1.0) * stiffness * half**2
        force = (pull_left + pull_right - weight * forward, side - weight * sideways)
        body.apply_force_at_local_point(force)
        body.torque += half * (pull_right - pull_left) - scrub * body.angular_velocity

    def _feel(self, arbiter: pymunk.Arbiter, space: pymunk.Space, data: object) -> None:
        self.impulse = max(self.impulse, arbiter.total_impulse.length)
