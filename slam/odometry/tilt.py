"""Which scans a tilted laser took: roll or pitch off their running median.

The INS's absolute tilt is useless after a shock; its change is not.
"""

from __future__ import annotations

from collections import deque

import numpy as np

from slam.measurements import Measurements
from slam.se2 import Array


def tilted_scans(measurements: Measurements, limit: float, window: int = 101) -> np.ndarray:
    """Scans ``(N,)`` bool whose roll or pitch is more than ``limit`` rad off its median over ``window``
    scans, as many before as after. All False without attitude."""
    from scipy.ndimage import median_filter

    if measurements.attitude is None or not np.isfinite(limit):
        return np.zeros(len(measurements), dtype=bool)
    unwrapped = np.unwrap(measurements.attitude, axis=0)
    recent = median_filter(unwrapped, size=(min(window, len(measurements)), 1), mode="nearest")
    return np.any(np.abs(unwrapped - recent) > limit, axis=1)


class TiltDetector:
    """The same scan by scan, the median of the last ``window`` scans (odd) alone; the first stands for those
    before it."""

    def __init__(self, limit: float, window: int) -> None:
        self.limit, self.window = limit, window
        self._recent: deque[Array] = deque(maxlen=window)

    def is_tilted(self, attitude: Array | None) -> bool:
        """Whether the next scan, taken at ``attitude (2,)`` rad (roll, pitch), is tilted."""
        if attitude is None or not np.isfinite(self.limit):
            return False
        if not self._recent:
            self._recent.extend([np.array(attitude, dtype=np.float64)] * self.window)
        unwrapped = np.unwrap([self._recent[-1], attitude], axis=0)[1]
        self._recent.append(unwrapped)
        median = np.sort(self._recent, axis=0)[self.window // 2]
        return bool(np.any(np.abs(unwrapped - median) > self.limit))
