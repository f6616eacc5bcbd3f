"""Whether a map made by the laser alone may be believed: one that knows it is lost is no answer."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stitch.mapping.estimate import Estimate


@dataclass(frozen=True)
class RejectionConfig:
    """When a map without dead reckoning is refused."""

    min_matched: float = 0.5
    """Share of the scans that must have been matched where nothing else tells how the robot moved."""
    max_sigma: float = 0.5
    """Standard deviation [m] in its worst direction up to which, in the median, a map is one; a map that is
    right has had 0.3 m and less, one that is lost in a corridor 0.7 m and more."""


def rejection_reason(estimate: Estimate, config: RejectionConfig = RejectionConfig()) -> str | None:
    """Why an estimate from the laser alone is no answer, None where it is one."""
    share = 1.0 if estimate.track is None else estimate.track.matched_share
    if share < config.min_matched:
        least = f"less than the {config.min_matched:.0%} it takes to map a drive without dead reckoning"
        return f"{share:.0%} of the scans could be matched, {least}"
    if estimate.covariance is None:
        return None
    largest = np.linalg.eigvalsh(estimate.covariance[:, :2, :2])[:, -1]
    sigma = float(np.sqrt(np.median(largest)))
    if sigma <= config.max_sigma:
        return None
    return (
        f"half of the scans are known to no better than {sigma:.1f} m by the laser alone, expected at most "
        f"{config.max_sigma:.1f} m (along a bare corridor it does not tell how far the robot went)"
    )
