"""How far paired points are apart."""

from __future__ import annotations

import numpy as np
from numba import njit


@njit(cache=True)
def residual_quantile(reference, scan, pairs, pose, share):
    """Distance [m] that a ``share`` of the pairs does not exceed; NaN without pairs.

    ``reference`` and ``scan`` are clouds, ``pairs (n,)`` the row of the reference's point for each point of
    the scan, -1 for none. Of k pairs it is the ⌈share·k⌉-th smallest distance.
    """
    c, s = np.cos(pose[2]), np.sin(pose[2])
    distances = np.empty(len(pairs))
    count = 0
    for i in range(len(pairs)):
        j = pairs[i]
        if j < 0:
            continue
        x = c * scan[0][i, 0] - s * scan[0][i, 1] + pose[0]
        y = s * scan[0][i, 0] + c * scan[0][i, 1] + pose[1]
        distances[count] = np.hypot(reference[0][j, 0] - x, reference[0][j, 1] - y)
        count += 1
    if count == 0:
        return np.nan
    return np.sort(distances[:count])[max(int(np.ceil(share * count)) - 1, 0)]
