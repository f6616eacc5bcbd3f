"""Every setting of every method, in one tree: `config.json` dumps it, and ``--config`` reads it back."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

from slam.mapping.self_consistency import SelfConsistencyConfig
from slam.matching import MatchConfig
from slam.odometry.segmentation import SegmentationConfig
from slam.odometry.tracker import MANIFOLD_SLAM, FrontendConfig
from stitch.alignment.config import AlignConfig
from stitch.mapping.config import MappingConfig

ICP = replace(
    FrontendConfig(),
    method="icp",
    covariance="joint",
    reference="scan",
    match=MatchConfig(levels=((0.5, 1), (0.3, 1)), mutual=True, robust=1e12, least_pairs=3, search_shift=0.0),
    trust_dead_reckoning=False,
)
"""Point-to-point ICP, scan to scan, without weights."""


@dataclass(frozen=True)
class HtmsConfig:
    """The thesis's stitching."""

    segmentation: SegmentationConfig = field(default_factory=lambda: SegmentationConfig(least_steps=5))
    """Where ManifoldSLAM's map is cut."""
    align: AlignConfig = field(default_factory=lambda: AlignConfig(method="htms"))
    """How its pieces are aligned."""


@dataclass(frozen=True)
class MethodConfig:
    """Settings of the methods."""

    slam: MappingConfig = field(default_factory=MappingConfig)
    """slamstitch, offline and online, and the oracle."""
    icp: FrontendConfig = ICP
    """The front end of icp."""
    manifold: FrontendConfig = MANIFOLD_SLAM
    """The front end of wsm and htms: ManifoldSLAM."""
    htms: HtmsConfig = field(default_factory=HtmsConfig)
    """The thesis's stitching."""
    self_consistency: SelfConsistencyConfig = field(default_factory=SelfConsistencyConfig)
    """How the map of every method is asked whether it agrees with itself."""
