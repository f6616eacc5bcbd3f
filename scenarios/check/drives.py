"""Small made drives that bring out what a method does wrong."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sim.laser import Raycaster
from slam import se2
from slam.recording import Laser, Recording
from slam.se2 import Array

SCANS, BLIND_SCANS = 60, 120
INTERVAL = 0.5
"""Seconds between scans: the blind ones last a minute."""
BACKWARDS, EVERY = 1.8, 10
"""So many seconds too early is the stamp of every tenth scan; the Intel laboratory's log has such steps."""
ANGLES = np.radians(np.linspace(-110.0, 110.0, 111))
LASER = Laser(range_max=8.0, mount_source="stated")
BOXES = ((0.0, 0.0, 6.0, 5.0), (2.6, 2.0, 3.4, 3.0), (4.8, 0.0, 6.0, 0.7), (0.0, 3.3, 0.8, 3.4))


def drive(seed: int = 0, scans: int = SCANS) -> Recording:
    """Round a furnished room of 6 × 5 m, with odometry that drifts."""
    rng = np.random.default_rng(seed)
    angle = np.linspace(0.0, 2.3 * np.pi, SCANS)
    angle = np.concatenate([angle, angle[-1] + 0.01 * np.arange(1, scans - SCANS + 1)])
    x, y = 3.0 + 1.7 * np.sin(angle), 2.5 - 1.4 * np.cos(angle)
    truth = np.column_stack([x, y, np.arctan2(1.4 * np.sin(angle), 1.7 * np.cos(angle))])
    ranges = Raycaster.from_segments(_walls()).cast(truth, ANGLES, LASER.range_max)
    ranges = ranges + rng.normal(0.0, 0.01, ranges.shape)
    steps = se2.between(truth[:-1], truth[1:]) * [1.02, 1.0, 1.03]
    reckoned = [truth[0]]
    for step in steps + rng.normal(0.0, 0.002, steps.shape):
        reckoned.append(se2.compose(reckoned[-1], step))
    time = INTERVAL * np.arange(scans)
    return Recording("check", time, ranges, ANGLES, LASER, np.array(reckoned), truth=truth)


def _walls() -> Array:
    """Sides ``(S, 4)`` of the boxes."""
    return np.array(
        [
            side
            for x0, y0, x1, y1 in BOXES
            for side in ([x0, y0, x1, y0], [x1, y0, x1, y1], [x1, y1, x0, y1], [x0, y1, x0, y0])
        ]
    )


def with_lies(recording: Recording) -> Recording:
    """The same with a truth that is none."""
    lie = np.random.default_rng(1).normal(0.0, 5.0, (len(recording), 3))
    return replace(recording, truth=lie)


def with_stamps_backwards(recording: Recording) -> Recording:
    """The same whose stamps go backwards here and there, in the same order."""
    time = recording.time.copy()
    time[EVERY::EVERY] -= BACKWARDS
    return replace(recording, time=time)


def with_blind_minute() -> Recording:
    """A drive in which no beam returns for a minute, while the robot creeps on; then it sees again."""
    recording = drive(scans=SCANS + BLIND_SCANS + 20)
    ranges = recording.ranges.copy()
    ranges[SCANS : SCANS + BLIND_SCANS] = np.nan
    return replace(recording, ranges=ranges)


def of_nothing() -> Recording:
    """A drive of which nothing can be known: no dead reckoning, and no beam returns after the first scan."""
    recording = drive().without_dead_reckoning()
    ranges = recording.ranges.copy()
    ranges[1:] = np.nan
    return replace(recording, ranges=ranges, truth=None)


def of_one_scan() -> Recording:
    """The first scan of a drive."""
    recording = drive()
    first = slice(0, 1)
    return replace(
        recording,
        time=recording.time[first],
        ranges=recording.ranges[first],
        dead_reckoning=recording.dead_reckoning[first],
        truth=None if recording.truth is None else recording.truth[first],
    )
