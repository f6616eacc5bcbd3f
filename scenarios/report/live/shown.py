"""Which scans the page shows, and the frame it draws everything in."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scenarios.evaluation.trajectory import aligned
from slam.recording import Recording
from slam.se2 import Array

MOST_SCANS = 4000
"""Of a longer drive every second, third … scan is shown: the page shall open at once."""


@dataclass(frozen=True)
class Shown:
    """The ``rows (M,)`` of a recording's scans that the page shows."""

    recording: Recording
    rows: np.ndarray

    @classmethod
    def of(cls, recording: Recording) -> Shown:
        """All scans, or evenly spread ones of a long drive."""
        step = -(-len(recording) // MOST_SCANS)
        return cls(recording, np.arange(0, len(recording), step))

    def placed(self, poses: Array) -> Array:
        """``poses (N, 3)`` of a method in the page's frame: laid onto truth where there is one."""
        return poses if self.recording.truth is None else aligned(poses, self.recording.truth)
