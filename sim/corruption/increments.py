"""Dead reckoning as steps from scan to scan, in the frame in which its source measures them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from slam import se2
from slam.recording import Recording
from slam.se2 import Array


def increments(recording: Recording) -> Array:
    """Steps ``(N - 1, 3)`` m, m, rad: an INS's in its own world frame, an odometry's in the body's."""
    before, after = recording.dead_reckoning[:-1], recording.dead_reckoning[1:]
    if recording.source == "odometry":
        return se2.between(before, after)
    steps = after - before
    steps[:, 2] = se2.wrap(steps[:, 2])
    return steps


def with_increments(recording: Recording, steps: Array) -> Recording:
    """The recording whose dead reckoning takes other ``steps (N - 1, 3)`` from the same start."""
    start = recording.dead_reckoning[:1]
    yaw = start[0, 2] + np.concatenate([[0.0], np.cumsum(steps[:, 2])])
    moved = steps[:, :2]
    if recording.source == "odometry":
        moved = np.einsum("nij,nj->ni", se2.rotation(yaw[:-1]), moved)
    position = start[0, :2] + np.vstack([np.zeros(2), np.cumsum(moved, axis=0)])
    return replace(recording, dead_reckoning=np.column_stack([position, se2.wrap(yaw)]))
