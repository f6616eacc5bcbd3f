"""Drives as long as one likes: one recording driven to its end, back to its start, and so on."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from slam.odometry.dead_reckoning import DeadReckoningConfig
from slam.recording import Recording
from slam.se2 import path_length

YAW_WALK = 0.006
"""Standard deviation [rad] of the yaw that dead reckoning loses per scan, beside what it lost already."""


def there_and_back(recording: Recording, times: int, rng: np.random.Generator) -> Recording:
    """The recording driven ``times`` over, backwards every second time.

    Ranges get new noise and dead reckoning a new drift, so that no place is seen twice alike. Raises
    ``ValueError`` for fewer than one time.
    """
    if times < 1:
        raise ValueError(f"a drive there and back: expected 1 time or more, got {times}")
    forwards = np.arange(len(recording))
    rows = np.concatenate([forwards[:: 1 if lap % 2 == 0 else -1] for lap in range(times)])
    new = np.arange(len(rows)) >= len(recording)
    walked = np.diff(path_length(recording.dead_reckoning[rows]), prepend=0.0)
    sigma = np.stack(
        [np.sqrt(DeadReckoningConfig().ins_walk * walked)] * 2 + [np.full(len(rows), YAW_WALK)], -1
    )
    drift = np.cumsum(np.where(new[:, None], rng.normal(0.0, 1.0, (len(rows), 3)) * sigma, 0.0), axis=0)
    noise = rng.normal(0.0, recording.laser.sigma_range, (len(rows), len(recording.angles)))
    return replace(
        recording,
        name=f"{recording.name} x {times}",
        time=float(np.median(np.diff(recording.time))) * np.arange(len(rows)),
        ranges=recording.ranges[rows] + np.where(new[:, None], noise, 0.0),
        dead_reckoning=recording.dead_reckoning[rows] + drift,
        odometry=None,
        attitude=None if recording.attitude is None else recording.attitude[rows],
        truth=None if recording.truth is None else recording.truth[rows],
        relations=None,
    )
