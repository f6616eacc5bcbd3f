"""Where the beams of a tilted laser point."""

from __future__ import annotations

import numpy as np
from numba import njit


@njit(cache=True, error_model="numpy")
def beam_directions(pose, angles):
    """Unit vectors ``(B, 3)`` in the world of beams at ``angles (B,)`` rad of a sensor at ``pose (6,)``.

    ``pose`` is x, y, yaw, roll, pitch, z; R = Rz(yaw) Ry(pitch) Rx(roll).
    """
    sin_yaw, cos_yaw = np.sin(pose[2]), np.cos(pose[2])
    sin_roll, cos_roll = np.sin(pose[3]), np.cos(pose[3])
    sin_pitch, cos_pitch = np.sin(pose[4]), np.cos(pose[4])
    out = np.empty((len(angles), 3))
    for b in range(len(angles)):
        c, s = np.cos(angles[b]), np.sin(angles[b])
        forward, left = cos_pitch * c + sin_pitch * sin_roll * s, cos_roll * s
        out[b, 0] = cos_yaw * forward - sin_yaw * left
        out[b, 1] = sin_yaw * forward + cos_yaw * left
        out[b, 2] = -sin_pitch * c + cos_pitch * sin_roll * s
    return out
