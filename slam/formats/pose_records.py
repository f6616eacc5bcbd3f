"""Poses logged at a rate of their own, looked up at the scans between them."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from slam.se2 import Array, wrap


@dataclass
class PoseRecords:
    """One sensor's records in file order, and how many of them precede each scan.

    A value is (x, y, yaw), (x, y, z, roll, pitch, yaw) or (roll, pitch), m and rad.
    """

    times: list[float] = field(default_factory=list)
    values: list[list[float]] = field(default_factory=list)
    before_scan: list[int] = field(default_factory=list)

    def add(self, time: float, value: list[float]) -> None:
        """The next record."""
        self.times.append(time)
        self.values.append(value)

    def scan(self) -> None:
        """A scan comes here."""
        self.before_scan.append(len(self.times))

    def at_scans(self, scan_times: Array) -> Array:
        """Values, a row for each of N scans, interpolated between the records before and after it in file
        order; its stamp only says where between them. Angles are wrapped.
        """
        times, values = np.array(self.times), np.array(self.values)
        angles = slice({2: 0, 3: 2, 6: 3}[values.shape[1]], None)
        values[:, angles] = np.unwrap(values[:, angles], axis=0)
        after = np.array(self.before_scan)
        last = np.clip(after - 1, 0, len(times) - 1)
        following = np.clip(after, 0, len(times) - 1)
        gap = times[following] - times[last]
        share = np.where(gap > 0.0, (scan_times - times[last]) / np.where(gap > 0.0, gap, 1.0), 0.0)
        share = np.clip(share, 0.0, 1.0)[:, None]
        result = values[last] + share * (values[following] - values[last])
        result[:, angles] = wrap(result[:, angles])
        return result
