"""The scans of one topic on one grid of angles.

Most cheap lasers turn unevenly: each message has its own number of ranges, its own first angle and its own
increment. All are resampled to the angles that most messages have.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from slam.formats.rosbag.names import ANGLE_DECIMALS, RANGE_DECIMALS, frame, seconds
from slam.formats.text import FormatError
from slam.se2 import Array

MOST_TURN = 2.1 * np.pi
"""Largest field of view [rad]: a full turn, and an overlap that drivers leave."""
GRAZING = np.tan(np.deg2rad(80.0))
"""Neighbouring beams see one surface unless their ranges differ as those on a wall seen at more than 80°."""


class Beams(NamedTuple):
    """Number of beams, first angle, increment and last angle [rad] of a message, as far as its bits mean
    something."""

    number: int
    first: float
    increment: float
    last: float

    @property
    def angles(self) -> Array:
        """Angles ``(number,)`` as sent, which may be clockwise."""
        last = self.first + self.increment * (self.number - 1)
        if abs(last - self.last) < 0.5 * abs(self.increment):
            return np.linspace(self.first, self.last, self.number)
        return self.first + self.increment * np.arange(self.number)


@dataclass
class LaserScans:
    """What the messages of ``topic`` said so far."""

    topic: str
    path: Path
    times: list[float] = field(default_factory=list)
    rows: list[Array] = field(default_factory=list)
    beams: list[Beams] = field(default_factory=list)
    messages: int = 0
    frame: str = ""
    limits: tuple[float, float] = (0.0, 0.0)

    def take(self, message: Any) -> bool:
        """The next message; False where it has no ranges, and is left out. Raises `FormatError`."""
        self.messages += 1
        if len(message.ranges) == 0:
            return False
        if not self.rows:
            self.frame = frame(message.header.frame_id)
            low, high = np.round([message.range_min, message.range_max], RANGE_DECIMALS)
            self.limits = float(low), float(high)
            if not 0.0 <= low < high:
                self._refuse(f"range_min is {low:g} and range_max {high:g}", "0 <= range_min < range_max")
        self.beams.append(self._beams_of(message))
        self.times.append(seconds(message.header.stamp))
        with np.errstate(invalid="ignore"):  # a signalling NaN is no return like any other
            self.rows.append(np.asarray(message.ranges, dtype=np.float64))
        return True

    def _beams_of(self, message: Any) -> Beams:
        count, step = len(message.ranges), float(message.angle_increment)
        first, last = np.round([message.angle_min, message.angle_max], ANGLE_DECIMALS).tolist()
        for name, value in (("angle_min", first), ("angle_increment", step)):
            if not np.isfinite(value):
                self._refuse(f"{name} is {value}", "radians")
        if step == 0.0 and count > 1:
            self._refuse("angle_increment is 0", "the angle between two beams")
        if abs(step) * (count - 1) > MOST_TURN:
            self._refuse(f"{count} beams are {step:g} rad apart", "a full turn at most")
        return Beams(count, first, step, last)

    def _refuse(self, what: str, expected: str) -> None:
        where = f"in message {self.messages} of {self.topic}"
        raise FormatError(f"{what} {where}, expected {expected}: mend its driver or leave it out", self.path)

    def grid(self) -> tuple[Array, Array]:
        """Angles ``(B,)`` rad, increasing, and ranges ``(N, B)`` m, NaN for what REP 117 calls no return."""
        common = Counter(self.beams).most_common(1)[0][0]
        angles = np.sort(common.angles)
        rows = [
            row[np.argsort(own.angles)] if own == common else resampled(row, own.angles, angles)
            for row, own in zip(map(self._cleaned, self.rows), self.beams, strict=True)
        ]
        return angles, np.array(rows)

    def _cleaned(self, row: Array) -> Array:
        low, high = self.limits
        row = np.round(row, RANGE_DECIMALS)
        return np.where((row >= low) & (row < high), row, np.nan)

    def __str__(self) -> str:
        low, high = self.limits
        common, *others = (shape for shape, _ in Counter(self.beams).most_common())
        turn = np.degrees(abs(common.increment) * (common.number - 1))
        text = f"{self.topic}, {common.number} beams over {turn:.0f}°, {low:g} to {high:g} m"
        if not others:
            return text
        counts = sorted(shape.number for shape in (common, *others))
        changed = sum(shape != common for shape in self.beams)
        return f"{text} ({changed} scans of {counts[0]} to {counts[-1]} resampled to these)"


def resampled(ranges: Array, angles: Array, grid: Array) -> Array:
    """Ranges ``(n,)`` of beams at ``angles (n,)`` rad, at those of ``grid (B,)``; NaN where none looked.

    Between two beams that see one surface the inverse of the range is interpolated, in which a wall is all
    but straight; elsewhere the nearer of the two counts.
    """
    order = np.argsort(angles)
    angles, ranges = angles[order], ranges[order]
    step = (angles[-1] - angles[0]) / max(len(angles) - 1, 1)
    if angles[-1] - angles[0] + 1.5 * step > 2.0 * np.pi:  # the first beam's neighbour is the last one
        angles = np.concatenate([angles - 2.0 * np.pi, angles, angles + 2.0 * np.pi])
        ranges = np.tile(ranges, 3)
        order = np.argsort(angles, kind="stable")
        angles, ranges = angles[order], ranges[order]
    after = np.clip(np.searchsorted(angles, grid), 1, max(len(angles) - 1, 1))
    before = after - 1
    after = np.minimum(after, len(angles) - 1)
    gap = np.maximum(angles[after] - angles[before], 1e-12)
    share = (grid - angles[before]) / gap
    low, high = ranges[before], ranges[after]
    nearest = np.where(share < 0.5, low, high)
    with np.errstate(invalid="ignore", divide="ignore"):
        one_surface = np.abs(high - low) < GRAZING * gap * np.minimum(low, high)
        between = 1.0 / ((1.0 - share) / low + share / high)
    inside = (share >= 0.0) & (share <= 1.0)
    looked = (share >= -0.5) & (share <= 1.5)
    return np.where(looked, np.where(one_surface & inside, between, nearest), np.nan)
