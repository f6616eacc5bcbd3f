"""What a robot logged: laser scans, dead reckoning and, where there is one, the truth."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Literal, get_args

import numpy as np

from slam import se2
from slam.se2 import Array

Source = Literal["ins", "odometry", "none"]


@dataclass(frozen=True)
class Laser:
    """A planar laser: limits and noise in metres, mount ``T_robot_laser (3,)`` (m, m, rad).

    ``mount_source`` names who says that it is mounted so, even if that is at the robot's origin; it is empty
    where nobody does.
    """

    range_min: float = 0.1
    range_max: float = 20.0
    sigma_range: float = 0.01
    T_robot_laser: Array = field(default_factory=lambda: np.zeros(3))
    mount_source: str = ""

    def __post_init__(self) -> None:
        if not (self.range_min >= 0.0 and self.range_max > self.range_min):
            raise ValueError(f"laser limits: expected 0 <= {self.range_min} < {self.range_max}")
        if not self.sigma_range > 0.0:
            raise ValueError(f"laser noise: expected sigma_range > 0, got {self.sigma_range}")
        object.__setattr__(self, "T_robot_laser", checked("T_robot_laser", self.T_robot_laser, (3,)))

    @property
    def mount_stated(self) -> bool:
        """Whether anybody says how it is mounted."""
        return bool(self.mount_source)


@dataclass(frozen=True)
class Odometry:
    """Dead reckoning at its full rate, in file order.

    ``time (M,)`` s, ``poses (M, 3)``, and ``scan_row (N,)``: the row in force when each scan was taken.
    """

    time: Array
    poses: Array
    scan_row: np.ndarray

    def __post_init__(self) -> None:
        m = len(self.time)
        object.__setattr__(self, "time", checked("odometry time", self.time, (m,)))
        object.__setattr__(self, "poses", checked("odometry poses", self.poses, (m, 3)))
        rows = np.asarray(self.scan_row, dtype=np.int64)
        if rows.size and not (rows.min() >= 0 and rows.max() < m):
            raise ValueError(f"odometry scan_row: expected rows in 0..{m - 1}")
        object.__setattr__(self, "scan_row", rows)


@dataclass(frozen=True)
class Relations:
    """Relative poses known to be true (Kümmerle et al. 2009): ``T_12 (K, 3)`` between ``stamps (K, 2)`` s."""

    stamps: Array
    T_12: Array

    def __post_init__(self) -> None:
        k = len(self.stamps)
        object.__setattr__(self, "stamps", checked("relation stamps", self.stamps, (k, 2)))
        object.__setattr__(self, "T_12", checked("relation poses", self.T_12, (k, 3)))


@dataclass(frozen=True)
class Recording:
    """One drive. Arrays are in file order; N scans of B beams.

    ``ranges (N, B)`` m with NaN for a beam without return, ``angles (B,)`` rad increasing
    counter-clockwise in the laser frame, ``dead_reckoning (N, 3)`` robot poses at the scans. With
    ``source="ins"`` position increments live in the INS's own world frame; with ``"odometry"`` in the
    body frame; with ``"none"`` there is no dead reckoning, and its poses are all the same. ``attitude
    (N, 2)`` is (roll, pitch) rad as the INS says, ``truth (N, 3)`` robot poses of a simulator or tracker.
    ``notes``: what reading it took of a log that holds more, assumed, or left out; the laser first.
    ``corruptions``: what was spoilt on purpose; dead reckoning is then no longer the full-rate odometry's.

    Raises ``ValueError`` when shapes disagree or a value that must be finite is not.
    """

    name: str
    time: Array
    ranges: Array
    angles: Array
    laser: Laser
    dead_reckoning: Array
    source: Source = "odometry"
    odometry: Odometry | None = None
    attitude: Array | None = None
    truth: Array | None = None
    relations: Relations | None = None
    notes: tuple[str, ...] = ()
    corruptions: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        n, b = len(self.time), len(self.angles)
        if n == 0:
            raise ValueError("a recording needs at least one scan")
        object.__setattr__(self, "time", checked("time", self.time, (n,)))
        object.__setattr__(self, "angles", checked("angles", self.angles, (b,)))
        object.__setattr__(self, "ranges", checked("ranges", self.ranges, (n, b), finite=False))
        object.__setattr__(self, "dead_reckoning", checked("dead_reckoning", self.dead_reckoning, (n, 3)))
        if b > 1 and np.any(np.diff(self.angles) <= 0.0):
            raise ValueError("angles must increase (counter-clockwise)")
        if self.source not in get_args(Source):
            raise ValueError(f"source: expected one of {get_args(Source)}, got {self.source!r}")
        if self.source == "none" and np.any(self.dead_reckoning != self.dead_reckoning[0]):
            raise ValueError("dead_reckoning: expected one pose for all scans, the source being 'none'")
        for name, width in (("attitude", 2), ("truth", 3)):
            if (value := getattr(self, name)) is not None:
                object.__setattr__(self, name, checked(name, value, (n, width)))
        if self.odometry is not None and len(self.odometry.scan_row) != n:
            raise ValueError(f"odometry scan_row: expected {n} rows, got {len(self.odometry.scan_row)}")

    def __len__(self) -> int:
        return len(self.time)

    @cached_property
    def distance(self) -> float:
        """Distance driven [m]: along the truth where there is one, else along the dead reckoning."""
        return float(se2.path_length(self.dead_reckoning if self.truth is None else self.truth)[-1])

    @property
    def full_rate(self) -> Odometry | None:
        """The full-rate odometry where the dead reckoning at the scans is taken from it: None where there is
        none, and where something was spoilt on purpose."""
        return None if self.source == "none" or self.corruptions else self.odometry

    def without_dead_reckoning(self) -> Recording:
        """The same drive, its laser alone having watched: dead reckoning says nothing.

        The full-rate odometry stays: relations are scored with it, and no method reads it.
        """
        return replace(self, dead_reckoning=np.zeros((len(self), 3)), source="none")

    def with_scans(self, kept: np.ndarray) -> Recording:
        """The same drive without the scans for which ``kept (N,)`` is False, which is noted."""
        if np.all(kept):
            return self
        parts = ("time", "ranges", "dead_reckoning", "attitude", "truth")
        given = {name: getattr(self, name) for name in parts if getattr(self, name) is not None}
        odometry = self.odometry and replace(self.odometry, scan_row=self.odometry.scan_row[kept])
        note = f"{np.sum(~kept)} of {len(self)} scans left out: another number of beams"
        selected = {name: value[kept] for name, value in given.items()}
        return replace(self, **selected, odometry=odometry, notes=(*self.notes, note))

    def with_relations(self, relations: Relations) -> Recording:
        """The same drive, to be scored against these relations."""
        return replace(self, relations=relations)

    def with_laser_mount(self, T_robot_laser: Array, source: str = "stated") -> Recording:
        """The same drive with its laser mounted as ``source`` says."""
        mount = np.asarray(T_robot_laser, dtype=float)
        return replace(self, laser=replace(self.laser, T_robot_laser=mount, mount_source=source))


def checked(name: str, value: object, shape: tuple[int, ...], finite: bool = True) -> Array:
    """``value`` as an array of floats of a ``shape``. Raises ``ValueError`` that calls it ``name``."""
    array: Array = np.asarray(value, dtype=np.float64, order="C")
    if array.shape != shape:
        raise ValueError(f"{name}: expected shape {shape}, got {array.shape}")
    if finite and not np.all(np.isfinite(array)):
        raise ValueError(f"{name}: expected finite values")
    return array
