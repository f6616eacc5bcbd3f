"""What the sensors have said so far: a recording that grows scan by scan while the robot drives."""

from __future__ import annotations

import numpy as np

from slam.recording import Laser, Recording, Source, checked
from slam.se2 import Array


class GrowingArray:
    """Rows of one shape, appended one by one; `rows` is a view, taken anew after each append."""

    def __init__(self, shape: tuple[int, ...]) -> None:
        self._rows: Array = np.zeros((64, *shape))
        self._count = 0

    @property
    def rows(self) -> Array:
        """All rows ``(n, ...)`` so far."""
        return self._rows[: self._count]

    def append(self, row: Array | float) -> None:
        """One more row."""
        if self._count == len(self._rows):
            self._rows = np.concatenate([self._rows, np.zeros_like(self._rows)])
        self._rows[self._count] = row
        self._count += 1


class MeasurementLog:
    """The fields of a `Recording` that a robot knows while it drives, of the n scans so far.

    ``laser`` and ``angles (B,)`` rad as in `Recording`. ``source`` tells what dead reckoning is: an INS's
    increments live in its world frame, an odometry's in the body; with "none" the laser is alone.
    """

    def __init__(self, laser: Laser, angles: Array, source: Source = "odometry") -> None:
        self.laser, self.angles, self.source = laser, np.asarray(angles, dtype=np.float64), source
        if self.angles.ndim != 1 or np.any(np.diff(self.angles) <= 0.0):
            raise ValueError("angles: expected (B,) rad, increasing counter-clockwise")
        self._time, self._dead_reckoning = GrowingArray(()), GrowingArray((3,))
        self._ranges, self._attitude = GrowingArray(self.angles.shape), GrowingArray((2,))

    def __len__(self) -> int:
        return len(self.time)

    @property
    def time(self) -> Array:
        """Stamps ``(n,)`` s."""
        return self._time.rows

    @property
    def ranges(self) -> Array:
        """Ranges ``(n, B)`` m, NaN for a beam without return."""
        return self._ranges.rows

    @property
    def dead_reckoning(self) -> Array:
        """Dead-reckoned robot poses ``(n, 3)``, all zero where the source is "none"."""
        return self._dead_reckoning.rows

    @property
    def attitude(self) -> Array | None:
        """Roll and pitch ``(n, 2)`` rad, None where they were never given."""
        return self._attitude.rows if len(self._attitude.rows) else None

    def append(
        self, ranges: Array, time: float, dead_reckoning: Array | None, attitude: Array | None = None
    ) -> None:
        """One more scan. Raises ``ValueError`` that names what cannot be used; nothing is appended then."""
        n = len(self)
        row = checked("ranges", ranges, self.angles.shape, finite=False)
        stamp = float(checked("time", time, ()))
        if n and stamp < self.time[-1]:
            raise ValueError(f"time: expected at least {self.time[-1]:g} s, the last scan's, got {stamp:g} s")
        if (dead_reckoning is None) != (self.source == "none"):
            given = "None" if dead_reckoning is None else "a pose"
            raise ValueError(f"dead_reckoning: got {given}, but the source is {self.source!r}")
        pose = checked("dead_reckoning", np.zeros(3) if dead_reckoning is None else dead_reckoning, (3,))
        if n and (attitude is None) != (self.attitude is None):
            raise ValueError("attitude: expected for every scan or for none")
        tilt = None if attitude is None else checked("attitude", attitude, (2,))
        self._ranges.append(row)
        self._time.append(stamp)
        self._dead_reckoning.append(pose)
        if tilt is not None:
            self._attitude.append(tilt)


Measurements = Recording | MeasurementLog
"""What odometry reads: a whole recording, or as much of one as there is."""
