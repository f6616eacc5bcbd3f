"""What a method says about a drive."""

from __future__ import annotations

from dataclasses import dataclass

from slam.posegraph import PoseGraph
from slam.se2 import Array
from slam.submap import Submap
from slam.track import Track
from stitch.align import NoStitch, Stitch


@dataclass(frozen=True)
class TriedStitch:
    """A pair of submaps (indices into ``Estimate.submaps``) that was tried, and what came of it.

    ``weight`` is what the robust graph left of it: 1 kept, 0 switched off, None where it never got there.
    """

    a: int
    b: int
    result: Stitch | NoStitch
    weight: float | None = None

    @property
    def accepted(self) -> bool:
        """True when the final map rests on this stitch."""
        return isinstance(self.result, Stitch) and (self.weight is None or self.weight > 0.5)


@dataclass(frozen=True)
class Estimate:
    """A method's answer: ``poses (N, 3)`` of the robot at every scan, and how it came about.

    ``covariance (N, 3, 3)`` are the marginals in the body frame, None where the method has none.
    """

    method: str
    poses: Array
    covariance: Array | None = None
    track: Track | None = None
    submaps: tuple[Submap, ...] = ()
    stitches: tuple[TriedStitch, ...] = ()
    graph_before: PoseGraph | None = None
    graph_after: PoseGraph | None = None
