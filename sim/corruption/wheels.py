"""Dead reckoning that measures wrongly: signs, scales, drift and slip."""

from __future__ import annotations

import numpy as np

from sim.corruption.increments import increments, with_increments
from sim.corruption.kind import Kind, Severity
from slam import se2
from slam.recording import Recording

BURST = 5.0
"""Mean number of steps in a burst of slip."""
LOST = (0.7, 1.0)
"""Share of a step's motion that slip takes."""


def lose_sign(recording: Recording, severity: float, rng: np.random.Generator) -> Recording:
    """Every step goes forward in the body, as where a logger keeps a speed without its sign."""
    steps = increments(recording)
    heading = 0.0 if recording.source == "odometry" else recording.dead_reckoning[:-1, 2]
    R = se2.rotation(np.broadcast_to(heading, len(steps)))
    body = np.einsum("nji,nj->ni", R, steps[:, :2])
    body[:, 0] = np.abs(body[:, 0])
    steps[:, :2] = np.einsum("nij,nj->ni", R, body)
    return with_increments(recording, steps)


def scale_distance(recording: Recording, severity: float, rng: np.random.Generator) -> Recording:
    """Steps are ``severity`` times as long."""
    return with_increments(recording, increments(recording) * [severity, severity, 1.0])


def scale_angle(recording: Recording, severity: float, rng: np.random.Generator) -> Recording:
    """Turns are ``severity`` times as wide."""
    return with_increments(recording, increments(recording) * [1.0, 1.0, severity])


def drift(recording: Recording, severity: float, rng: np.random.Generator) -> Recording:
    """A turn of ``severity`` degrees is added to every metre."""
    steps = increments(recording)
    steps[:, 2] += np.radians(severity) * np.hypot(steps[:, 0], steps[:, 1])
    return with_increments(recording, steps)


def slip(recording: Recording, severity: float, rng: np.random.Generator) -> Recording:
    """A share ``severity`` of the steps, in bursts, loses most of its motion and turning."""
    steps = increments(recording)
    count = round(severity * len(steps))
    slipping = np.zeros(len(steps), dtype=bool)
    while (left := count - slipping.sum()) > 0:
        start = rng.integers(len(steps))
        slipping[start : start + min(rng.geometric(1.0 / BURST), left)] = True
    steps[slipping] *= 1.0 - rng.uniform(*LOST, (slipping.sum(), 1))
    return with_increments(recording, steps)


SCALE = {"unit": "", "least": 0.1, "most": 10.0, "levels": (1.1, 1.2, 0.7), "default": 1.2}
KINDS = (
    Kind(
        "odometry.sign",
        "driving backwards is recorded as driving forwards",
        lose_sign,
        drawn=False,
        needs_dead_reckoning=True,
    ),
    Kind(
        "odometry.scale_distance",
        "distances are recorded too long or too short",
        scale_distance,
        Severity("factor", **SCALE),  # type: ignore[arg-type]
        drawn=False,
        needs_dead_reckoning=True,
    ),
    Kind(
        "odometry.scale_angle",
        "turns are recorded too wide or too narrow",
        scale_angle,
        Severity("factor", **SCALE),  # type: ignore[arg-type]
        drawn=False,
        needs_dead_reckoning=True,
    ),
    Kind(
        "odometry.drift",
        "the yaw drifts steadily with the distance driven",
        drift,
        Severity("turn per metre", "°/m", -90.0, 90.0, (0.2, 0.5, 2.0), 0.5),
        drawn=False,
        needs_dead_reckoning=True,
    ),
    Kind(
        "odometry.slip",
        "steps, in bursts, lose 70 to 100 % of their motion",
        slip,
        Severity("share of the steps", "", 0.0, 1.0, (0.05, 0.1, 0.3), 0.1),
        needs_dead_reckoning=True,
    ),
)
"""The entries of this family."""
