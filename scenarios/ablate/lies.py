"""Recordings that are not what they say: five lies, each drawn from a generator."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from slam import se2
from slam.recording import Recording
from slam.se2 import Array

FROZEN_SCANS, FROZEN_TIMES = 20, 3
"""How many scans the odometry stands still, and how often."""
SLIPPING, SLIP = 0.1, (0.7, 1.0)
"""Share of the steps that slip, and by what share of them."""
DROPPED = 0.5
"""Share of the beams that are lost."""
NOISE = 0.05
"""Standard deviation [m] of the noise added to the ranges."""


def _steps(recording: Recording) -> Array:
    return se2.between(recording.dead_reckoning[:-1], recording.dead_reckoning[1:])


def _driven(recording: Recording, steps: Array) -> Recording:
    """The recording as if dead reckoning had counted these ``steps (N - 1, 3)``."""
    poses = [recording.dead_reckoning[0]]
    for step in steps:
        poses.append(se2.compose(poses[-1], step))
    return replace(recording, dead_reckoning=np.array(poses))


def freeze(recording: Recording, rng: np.random.Generator) -> Recording:
    """The odometry stands still for a while, a few times."""
    steps = _steps(recording)
    starts = rng.choice(max(len(steps) - FROZEN_SCANS, FROZEN_TIMES), FROZEN_TIMES, replace=False)
    for start in starts:
        steps[start : start + FROZEN_SCANS] = 0.0
    return _driven(recording, steps)


def delay(recording: Recording, rng: np.random.Generator) -> Recording:
    """The odometry comes one scan late."""
    reckoned = recording.dead_reckoning
    return replace(recording, dead_reckoning=np.concatenate([reckoned[:1], reckoned[:-1]]))


def slip(recording: Recording, rng: np.random.Generator) -> Recording:
    """Wheels that slip in some steps."""
    steps = _steps(recording)
    slipping = rng.random(len(steps)) < SLIPPING
    steps[slipping] *= 1.0 - rng.uniform(*SLIP, (int(slipping.sum()), 1))
    return _driven(recording, steps)


def drop(recording: Recording, rng: np.random.Generator) -> Recording:
    """Beams are lost, each by chance."""
    lost = rng.random(recording.ranges.shape) < DROPPED
    return replace(recording, ranges=np.where(lost, np.nan, recording.ranges))


def blur(recording: Recording, rng: np.random.Generator) -> Recording:
    """Ranges are noisier than the laser says."""
    noisy = recording.ranges + rng.normal(0.0, NOISE, recording.ranges.shape)
    return replace(recording, ranges=np.maximum(noisy, recording.laser.range_min))


LIES: dict[str, Callable[[Recording, np.random.Generator], Recording]] = {
    "frozen": freeze,
    "late": delay,
    "slip": slip,
    "dropped": drop,
    "noise": blur,
}
"""Lies by name."""
