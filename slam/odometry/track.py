"""What a front end says about a drive: a pose, a covariance and a verdict per scan."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import IntEnum

import numpy as np

from slam.se2 import Array


class Verdict(IntEnum):
    """What happened to a scan."""

    MATCHED = 0
    """The matcher answered and was believed."""
    FELL_BACK = 1
    """No usable match: the pose comes from dead reckoning."""
    SKIPPED = 2
    """The robot had hardly moved: not matched, the pose is carried forward."""


@dataclass(frozen=True)
class Track:
    """Front-end output for N scans.

    ``poses (N, 3)`` robot in the map frame; ``verdict (N,)`` of `Verdict`; ``reference (N,)`` the scan
    index each pose was estimated against (-1 for the first); ``covariance (N, 3, 3)`` of the step from
    that reference in the body frame of the scan, NaN where there is none; ``information (N, 3, 3)`` what
    the match alone said of it, weak directions faded out, zero where it said nothing; ``matches (N,)``
    pairs in the last iteration; ``confidence`` named columns ``(N,)``, larger = worse, +inf where a match
    was tried and failed and NaN where none was tried. ``contradicted (N,)`` bool marks the scans whose match
    says that dead reckoning's step is wrong.
    """

    poses: Array
    verdict: np.ndarray
    reference: np.ndarray
    covariance: Array
    information: Array
    matches: np.ndarray
    confidence: dict[str, Array]
    contradicted: np.ndarray = field(default_factory=lambda: np.zeros(0, dtype=bool))

    def __post_init__(self) -> None:
        if len(self.contradicted) == 0:
            object.__setattr__(self, "contradicted", np.zeros(len(self.poses), dtype=bool))

    @property
    def matched_share(self) -> float:
        """Share of the scans that were tried whose match was believed; 1 where none was tried."""
        tried = self.verdict != Verdict.SKIPPED
        return float(np.mean(self.verdict[tried] == Verdict.MATCHED)) if np.any(tried) else 1.0

    @property
    def place_sigma(self) -> Array:
        """Standard deviation ``(N,)`` m of a match's place in its weakest direction, its yaw being unknown;
        of what says nothing, infinite."""
        information = self.information
        with np.errstate(divide="ignore", invalid="ignore"):
            turning = np.einsum("ni,nj->nij", information[:, :2, 2], information[:, 2, :2])
            place = information[:, :2, :2] - np.nan_to_num(turning / information[:, 2, 2, None, None])
            return 1.0 / np.sqrt(np.maximum(np.linalg.eigvalsh(place)[:, 0], 0.0))

    def __len__(self) -> int:
        return len(self.poses)
