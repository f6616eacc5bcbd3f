"""Dead reckoning that is right where it is measured and spoilt on its way into the recording."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sim.corruption.increments import increments, with_increments
from sim.corruption.kind import Kind, Severity
from slam import se2
from slam.recording import Recording

FROZEN = 20
"""Scans that a freeze lasts."""
JUMP = 1.0
"""Length of a jump [m]."""


def freeze(recording: Recording, severity: float, rng: np.random.Generator) -> Recording:
    """So many times the pose stays for `FROZEN` scans, and then goes on from where it stayed."""
    count, steps = int(severity), increments(recording)
    free = len(steps) - count * FROZEN
    if free < 0:
        raise ValueError(
            f"odometry.frozen={count}: expected more than {count * FROZEN} scans, got {len(recording)}"
        )
    gaps = np.sort(rng.integers(0, free + 1, count))
    for start in gaps + FROZEN * np.arange(count):
        steps[start : start + FROZEN] = 0.0
    return with_increments(recording, steps)


def delay(recording: Recording, severity: float, rng: np.random.Generator) -> Recording:
    """Every scan gets the pose of ``severity`` scans before; the first ones get the first pose."""
    n, late = len(recording), int(severity)
    if abs(late) >= n:
        raise ValueError(f"odometry.late={late}: expected a recording of more scans, got {n}")
    rows = np.clip(np.arange(n) - late, 0, n - 1)
    return replace(recording, dead_reckoning=recording.dead_reckoning[rows])


def jump(recording: Recording, severity: float, rng: np.random.Generator) -> Recording:
    """At so many steps the pose jumps by `JUMP`, anywhere, and goes on from there."""
    count, steps = int(severity), increments(recording)
    if count > len(steps):
        raise ValueError(f"odometry.jumps={count}: expected more than {count} scans, got {len(recording)}")
    rows = rng.choice(len(steps), count, replace=False)
    direction = rng.uniform(-np.pi, np.pi, count)
    steps[rows, :2] += JUMP * np.column_stack([np.cos(direction), np.sin(direction)])
    return with_increments(recording, steps)


def mistake_frame(recording: Recording, severity: float, rng: np.random.Generator) -> Recording:
    """An INS's increments are said to be an odometry's, and the reverse."""
    return replace(recording, source="odometry" if recording.source == "ins" else "ins")


def quantise(recording: Recording, severity: float, rng: np.random.Generator) -> Recording:
    """Poses are rounded to multiples of ``severity``, m and rad."""
    poses = severity * np.round(recording.dead_reckoning / severity)
    poses[:, 2] = se2.wrap(poses[:, 2])
    return replace(recording, dead_reckoning=poses)


def forget(recording: Recording, severity: float, rng: np.random.Generator) -> Recording:
    """There is no dead reckoning at all."""
    return recording.without_dead_reckoning()


KINDS = (
    Kind(
        "odometry.frozen",
        f"the pose stays for {FROZEN} scans; the motion meanwhile is lost",
        freeze,
        Severity("how many times", "", 1.0, 1000.0, (1.0, 3.0, 6.0), 3.0, whole=True),
        needs_dead_reckoning=True,
    ),
    Kind(
        "odometry.late",
        "a scan gets the pose of an earlier one, or of a later one where negative",
        delay,
        Severity("how many", "scans", -1000.0, 1000.0, (1.0, 2.0, 5.0), 1.0, whole=True),
        drawn=False,
        needs_dead_reckoning=True,
    ),
    Kind(
        "odometry.jumps",
        f"the position jumps by {JUMP:g} m in any direction",
        jump,
        Severity("how many times", "", 1.0, 1000.0, (2.0, 5.0, 15.0), 5.0, whole=True),
        needs_dead_reckoning=True,
    ),
    Kind(
        "odometry.frame",
        "increments in the world are taken for ones in the body, or the reverse",
        mistake_frame,
        drawn=False,
        needs_dead_reckoning=True,
    ),
    Kind(
        "odometry.quantised",
        "x, y and yaw are rounded, yaw to as many radians",
        quantise,
        Severity("step", "m", 1e-6, 10.0, (0.02, 0.05, 0.2), 0.05),
        drawn=False,
        needs_dead_reckoning=True,
    ),
    Kind("odometry.missing", "no dead reckoning at all", forget, drawn=False, needs_dead_reckoning=True),
)
"""The entries of this family."""
