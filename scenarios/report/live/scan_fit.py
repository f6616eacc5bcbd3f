"""Which beams of a scan fit what was seen just before it."""

from __future__ import annotations

import numpy as np

from slam import se2
from slam.mapping import keyframes
from slam.recording import Recording
from slam.se2 import Array

CELL = 0.1
"""Side of a cell [m]; a beam fits when a wall was seen in its cell or one of the eight around it."""
MEMORY = 20
"""Keyframes that are remembered: as many as the front end's local map has."""
PERIOD = 2048
"""Cells after which the plane repeats: 205 m, more than any laser here reaches."""

_NEIGHBOURS = np.indices((3, 3)).reshape(2, 9) - 1


def fitting_beams(recording: Recording, poses: Array, rows: np.ndarray) -> np.ndarray:
    """Which beams of the scans ``rows (M,)`` end at a wall that the last keyframes saw, ``(M, B)`` bool.

    Scans lie at ``poses (N, 3)``. What a method's matcher paired is not recorded; this is the same test for
    all of them.
    """
    cells, seen = _cells(recording, poses)
    kept = set(keyframes.choose(poses).tolist())
    wanted = {int(row): i for i, row in enumerate(rows)}
    last_seen = np.full((PERIOD, PERIOD), -MEMORY - 1, dtype=np.int32)
    fits = np.zeros((len(rows), cells.shape[1]), dtype=bool)
    number = 0
    for k in sorted(kept | set(wanted)):
        x, y = cells[k, seen[k]].T
        if k in wanted:
            fits[wanted[k], seen[k]] = last_seen[x, y] >= number - MEMORY
        if k in kept:
            last_seen[(x[:, None] + _NEIGHBOURS[0]) % PERIOD, (y[:, None] + _NEIGHBOURS[1]) % PERIOD] = number
            number += 1
    return fits


def has_return(recording: Recording) -> np.ndarray:
    """Which beams ``(N, B)`` have a return within the laser's limits."""
    laser = recording.laser
    return (recording.ranges >= laser.range_min) & (recording.ranges < laser.range_max)


def _cells(recording: Recording, poses: Array) -> tuple[np.ndarray, np.ndarray]:
    """Cells ``(N, B, 2)`` that the beams end in, and which beams ``(N, B)`` have a return."""
    seen = has_return(recording)
    T = se2.compose(poses, recording.laser.T_robot_laser)
    bearing = T[:, 2:] + recording.angles
    r = np.where(seen, recording.ranges, 0.0)
    ends = T[:, None, :2] + np.stack([r * np.cos(bearing), r * np.sin(bearing)], -1)
    return np.floor(ends / CELL).astype(np.int64) % PERIOD, seen
