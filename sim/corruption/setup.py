"""A laser that is not what, where or when its recording says."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sim.corruption.kind import Kind, Severity
from slam.recording import Recording
from slam.se2 import Array

SHIFT, TURN = 0.05, np.deg2rad(3.0)
"""By how much a mount is off at severity 1 [m, rad]."""


def narrow(recording: Recording, severity: float, rng: np.random.Generator) -> Recording:
    """There are no beams but those within ``severity`` degrees about the middle of the scan."""
    angles = recording.angles
    middle = 0.5 * (angles[0] + angles[-1])
    kept = np.abs(angles - middle) <= 0.5 * np.radians(severity) + 1e-9
    if kept.sum() < 2:
        raise ValueError(f"laser.sector={severity:g}: expected a sector that holds two beams or more")
    return replace(recording, ranges=recording.ranges[:, kept], angles=angles[kept])


def shift_mount(recording: Recording, severity: float, rng: np.random.Generator) -> Recording:
    """The stated mount is off, in any direction and to either side."""
    direction, side = rng.uniform(-np.pi, np.pi), rng.choice([-1.0, 1.0])
    off = severity * np.array([SHIFT * np.cos(direction), SHIFT * np.sin(direction), side * TURN])
    return recording.with_laser_mount(recording.laser.T_robot_laser + off, "a corruption")


def stamp_late(recording: Recording, severity: float, rng: np.random.Generator) -> Recording:
    """Scans are stamped ``severity`` s late, so that each is given the dead reckoning, and the attitude, of
    that much later. The stamps that are kept are the right ones: poses are scored by them."""
    time = np.maximum.accumulate(recording.time)
    reckoned = _later(recording.dead_reckoning, time, severity, angles=slice(2, 3))
    attitude = recording.attitude
    if attitude is not None:
        attitude = _later(attitude, time, severity, angles=slice(0, 2))
    return replace(recording, dead_reckoning=reckoned, attitude=attitude)


def _later(values: Array, time: Array, seconds: float, angles: slice) -> Array:
    """``values (N, d)`` at ``time (N,)`` so many seconds later, some columns being ``angles``."""
    even = values.copy()
    even[:, angles] = np.unwrap(even[:, angles], axis=0)
    columns = [np.interp(time + seconds, time, c) - np.interp(time, time, c) for c in even.T]
    return values + np.column_stack(columns)


def turn_over(recording: Recording, severity: float, rng: np.random.Generator) -> Recording:
    """The laser hangs upside down, and nobody says so: left is right."""
    return replace(recording, ranges=recording.ranges[:, ::-1])


KINDS = (
    Kind(
        "laser.sector",
        "the laser sees a narrow sector only",
        narrow,
        Severity("its width", "°", 1.0, 360.0, (150.0, 90.0, 60.0), 90.0),
        drawn=False,
    ),
    Kind(
        "laser.mount",
        f"the mount is stated wrongly, by {SHIFT:g} m and {np.degrees(TURN):g}° at 1",
        shift_mount,
        Severity("how many times that", "", 0.0, 20.0, (0.5, 1.0, 2.0), 1.0),
    ),
    Kind(
        "laser.time",
        "scans are stamped late, or early where negative, and given another time's dead reckoning",
        stamp_late,
        Severity("how late", "s", -3600.0, 3600.0, (0.1, 0.2, 0.5), 0.2),
        drawn=False,
        needs_dead_reckoning=True,
    ),
    Kind("laser.upside_down", "the laser hangs upside down, and nobody says so", turn_over, drawn=False),
)
"""The entries of this family."""
