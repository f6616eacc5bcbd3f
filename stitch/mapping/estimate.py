"""What a method says about a drive, and whether that may be believed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from slam.graph.pose_graph import PoseGraph
from slam.mapping.self_consistency import SelfConsistency
from slam.mapping.submap import Submap
from slam.odometry.laser_mount import Mount
from slam.odometry.odometry_faults import OdometryFaults
from slam.odometry.track import Track
from slam.se2 import Array
from stitch.align import NoStitch, Prior, Stitch


@dataclass(frozen=True)
class LoopCandidate:
    """A pair of submaps (indices into ``Estimate.submaps``) that was tried, and what came of it.

    ``weight`` is what the robust graph left of it: 1 kept, 0 switched off, None where it never got there.
    ``round`` counts the rounds through the drive, from 0; in each a pair is tried when the drive has come to
    the end of b. ``prior`` is where the graph expected b, None where everything was searched. A pair that was
    refused may be tried again, which is another entry.
    """

    a: int
    b: int
    result: Stitch | NoStitch
    weight: float | None = None
    round: int = 0
    prior: Prior | None = None

    @property
    def accepted(self) -> bool:
        """True when the final map rests on this stitch."""
        return isinstance(self.result, Stitch) and (self.weight is None or self.weight > 0.5)


@dataclass(frozen=True)
class OnlineResult:
    """What was answered on the way: ``poses (N, 3)`` of each scan as given when it arrived, and the
    ``seconds (N,)`` from its arrival until then."""

    poses: Array
    seconds: Array


@dataclass(frozen=True)
class NoEstimate:
    """A method has no answer for a recording, and why."""

    method: str
    reason: str


@dataclass(frozen=True)
class Estimate:
    """A method's answer: ``poses (N, 3)`` of the robot at every scan, and how it came about.

    ``covariance (N, 3, 3)`` are the marginals in the body frame, None where the method has none; ``online``
    is what a method answered that works scan by scan; ``laser_mount`` where the laser was found to sit, None
    where that was stated or could not be told; ``odometry_faults`` what of its odometry was corrected, None
    where nothing was; ``consistency`` whether its map agrees with itself, None where nobody asked.
    """

    method: str
    poses: Array
    covariance: Array | None = None
    track: Track | None = None
    submaps: tuple[Submap, ...] = ()
    stitches: tuple[LoopCandidate, ...] = ()
    graph_before: PoseGraph | None = None
    graph_after: PoseGraph | None = None
    online: OnlineResult | None = None
    laser_mount: Mount | None = None
    odometry_faults: OdometryFaults | None = None
    consistency: SelfConsistency | None = None


@dataclass(frozen=True)
class RejectionConfig:
    """When a map without dead reckoning, which may know that it is lost, is refused."""

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
