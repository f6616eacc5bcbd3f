"""A recording becomes a map: track, cut, stitch, close the loops, adjust.

`map_recording` answers for a whole recording, `OnlineMapper` scan by scan; both take a `MappingConfig` and
know nothing of the benchmark.
"""

from stitch.mapping.config import MappingConfig
from stitch.mapping.estimate import Estimate, LoopCandidate, NoEstimate
from stitch.mapping.offline import map_recording
from stitch.mapping.online import OnlineMapper, replay_online

__all__ = [
    "Estimate",
    "LoopCandidate",
    "MappingConfig",
    "NoEstimate",
    "OnlineMapper",
    "map_recording",
    "replay_online",
]
