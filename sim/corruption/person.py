"""A person who walks along beside the robot."""

from __future__ import annotations

import numpy as np

from sim.corruption.beams import with_ranges
from sim.corruption.kind import Kind, Severity
from slam import se2
from slam.recording import Recording
from slam.se2 import Array

RADIUS = 0.2
"""Of a person, a circle [m]."""
SIDE = 0.6
"""A person walks within this share of the laser's field of view."""
SWAY, STEADY = np.deg2rad(10.0), 0.95
"""Standard deviation of a person's bearing [rad], and how much of it is left at the next scan."""


def accompany(recording: Recording, severity: float, rng: np.random.Generator) -> Recording:
    """The beams that meet a person ``severity`` m away end there."""
    angles = recording.angles
    middle, half = 0.5 * (angles[0] + angles[-1]), 0.5 * (angles[-1] - angles[0])
    bearing = middle + rng.uniform(-SIDE, SIDE) * half + _wander(len(recording), SWAY, rng)
    distance = severity + _wander(len(recording), 0.1 * (severity - RADIUS), rng)
    off = se2.wrap(angles - bearing[:, None])
    inside = RADIUS**2 - (distance[:, None] * np.sin(off)) ** 2
    meets = (inside >= 0.0) & (np.abs(off) < 0.5 * np.pi)
    skin = distance[:, None] * np.cos(off) - np.sqrt(np.maximum(inside, 0.0))
    return with_ranges(recording, np.fmin(recording.ranges, np.where(meets, skin, np.nan)))


def _wander(n: int, sigma: float, rng: np.random.Generator) -> Array:
    """A random walk ``(n,)`` about zero, with the standard deviation ``sigma`` from the first on."""
    shocks = sigma * rng.standard_normal(n)
    values = shocks.copy()
    for k in range(1, n):
        values[k] = STEADY * values[k - 1] + np.sqrt(1.0 - STEADY**2) * shocks[k]
    return values


KINDS = (
    Kind(
        "laser.person",
        "a person walks along beside the robot",
        accompany,
        Severity("how far away", "m", 0.4, 30.0, (2.0, 1.0, 0.5), 1.0),
    ),
)
"""The entry of this family."""
