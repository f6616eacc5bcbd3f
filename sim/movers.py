"""What moves in a world besides the robot: debris that it pushes, and people who walk."""

from __future__ import annotations

import math
from bisect import bisect_right
from dataclasses import dataclass

import numpy as np

from sim.floorplan import BELOW_FLOOR, Prism, round_prism
from slam.se2 import Array


@dataclass(frozen=True)
class Debris:
    """A loose solid of ``mass`` kg where ``prism`` is at first, its heights above the ground under it.

    ``friction`` is Coulomb's coefficient between it and the ground. Raises ``ValueError`` unless mass > 0
    and friction >= 0.
    """

    prism: Prism
    mass: float
    friction: float = 0.5

    def __post_init__(self) -> None:
        if not (self.mass > 0.0 and self.friction >= 0.0):
            raise ValueError(
                f"debris: expected mass > 0 and friction >= 0, got {self.mass} and {self.friction}"
            )

    @property
    def centre(self) -> Array:
        """Centre of mass (2) m at first; the body frame is there, parallel to the world's."""
        x, y = self.prism.footprint.T
        cross = x * np.roll(y, -1) - np.roll(x, -1) * y
        sums = self.prism.footprint + np.roll(self.prism.footprint, -1, axis=0)
        return cross @ sums / (3.0 * cross.sum())

    @property
    def shape(self) -> Prism:
        """The solid in its body frame."""
        return Prism(self.prism.footprint - self.centre, self.prism.z_lo, self.prism.z_hi, self.prism.kind)


@dataclass(frozen=True)
class Person:
    """Somebody who walks round the closed ``loop (K, 2)`` m at ``speed`` m/s for ever.

    ``start``: share of the loop already walked at time 0. Turns round rather than come nearer than
    ``keep_off`` m to the robot. Raises ``ValueError`` for a loop without length or fewer than two points.
    """

    loop: Array
    speed: float = 1.0
    start: float = 0.0
    radius: float = 0.2
    height: float = 1.75
    keep_off: float = 0.8

    def __post_init__(self) -> None:
        loop = np.ascontiguousarray(self.loop, dtype=np.float64)
        if loop.ndim != 2 or loop.shape[0] < 2 or loop.shape[1] != 2:
            raise ValueError(f"person: expected a loop (K >= 2, 2), got {loop.shape}")
        if not np.all(np.hypot(*(np.roll(loop, -1, axis=0) - loop).T) > 0.0):
            raise ValueError("person: expected legs of the loop with length > 0")
        if not (self.speed >= 0.0 and self.radius > 0.0):
            raise ValueError(
                f"person: expected speed >= 0 and radius > 0, got {self.speed} and {self.radius}"
            )
        object.__setattr__(self, "loop", loop)

    @property
    def shape(self) -> Prism:
        """The person as an upright solid in the body frame."""
        return round_prism([0.0, 0.0], self.radius, 8, BELOW_FLOOR, self.height, "furniture")


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
