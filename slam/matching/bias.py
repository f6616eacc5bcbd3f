"""What another kind of sensor adds to every point: a mean offset, and how uncertain it is."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from slam.scan import Scan
from slam.se2 import Array


@dataclass(frozen=True)
class Bias:
    """Offset of a scan's points against what the reference's sensor would have measured (Pfister 2002).

    ``mean`` m and ``covariance`` m² are in the frame of the scan, ``(2,)`` and ``(2, 2)`` for all points
    alike, or ``(n, 2)`` and ``(n, 2, 2)``. Two scans of one sensor have none.
    """

    mean: Array
    covariance: Array

    @classmethod
    def of_range(cls, scan: Scan, mean: float, sigma: float, origin: Array = (0.0, 0.0)) -> Bias:  # type: ignore[assignment]
        """Ranges too long by ``mean`` ± ``sigma`` m, measured from ``origin (2,)`` in the scan's frame."""
        beams = scan.points - np.asarray(origin)
        beams /= np.linalg.norm(beams, axis=1, keepdims=True)
        return cls(mean * beams, sigma**2 * beams[:, :, None] * beams[:, None, :])

    def removed(self, scan: Scan) -> Scan:
        """The scan without the mean offset, its points less certain. Raises ``ValueError`` on a shape that
        does not fit the scan."""
        n = len(scan)
        if np.shape(self.mean) not in ((2,), (n, 2)) or np.shape(self.covariance) not in ((2, 2), (n, 2, 2)):
            raise ValueError(
                f"bias: expected (2,) or ({n}, 2) and (2, 2) or ({n}, 2, 2), "
                f"got {np.shape(self.mean)} and {np.shape(self.covariance)}"
            )
        return replace(scan, points=scan.points - self.mean, covariance=scan.covariance + self.covariance)
