"""What somebody says of a drive: poses by their stamps, and how sure they are."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from slam.recording import checked
from slam.se2 import Array

Body = Literal["robot", "laser", ""]
"""Whose poses they are; empty where a file does not say."""
LARGEST_ASYMMETRY = 1e-6
"""A covariance may differ from its transpose by this share of its largest entry: files are rounded."""


@dataclass(frozen=True)
class Trajectory:
    """Poses ``(N, 3)`` (m, m, rad) at stamps ``time (N,)`` s, in file order.

    ``covariance (N, 3, 3)`` is of each pose in its own body tangent, order (x, y, yaw); None where it is not
    stated. ``body``: whose poses they are. Raises ``ValueError`` for shapes that disagree, for no poses, and
    for values that are not finite.
    """

    time: Array
    poses: Array
    covariance: Array | None = None
    body: Body = ""

    def __post_init__(self) -> None:
        n = len(self.time)
        if n == 0:
            raise ValueError("no poses, expected at least one")
        object.__setattr__(self, "time", checked("time", self.time, (n,)))
        object.__setattr__(self, "poses", checked("poses", self.poses, (n, 3)))
        if self.body not in get_args(Body):
            raise ValueError(f"body: expected one of {get_args(Body)}, got {self.body!r}")
        if self.covariance is None:
            return
        sigma = checked("covariance", self.covariance, (n, 3, 3))
        apart = np.abs(sigma - np.swapaxes(sigma, 1, 2)).max(axis=(1, 2))
        if np.any(apart > LARGEST_ASYMMETRY * np.abs(sigma).max(axis=(1, 2))):
            raise ValueError(f"covariance of pose {int(np.argmax(apart))}: expected a symmetric matrix")
        object.__setattr__(self, "covariance", sigma)

    def __len__(self) -> int:
        return len(self.time)
