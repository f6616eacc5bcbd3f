"""Every setting of every method, in one tree that `config.json` dumps."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

from slam.matching import MatchConfig
from slam.odometry.segmentation import SegmentationConfig
from slam.odometry.tracker import MANIFOLD_SLAM, FrontendConfig
from stitch.alignment.config import AlignConfig
from stitch.mapping.bundle import BundleConfig
from stitch.mapping.loop_closure import LoopConfig


def _icp() -> FrontendConfig:
    unweighted = MatchConfig(
        levels=((0.5, 1), (0.3, 1)), mutual=True, robust=1e12, least_pairs=3, search_shift=0.0
    )
    return replace(
        FrontendConfig(),
        method="icp",
        covariance="joint",
        reference="scan",
        match=unweighted,
        trust_dead_reckoning=False,
    )


@dataclass(frozen=True)
class MethodConfig:
    """Settings of the methods: ``manifold`` and ``segmentation`` serve wsm and htms, ``frontend``,
    ``loops`` and ``bundle`` serve slamstitch, ``icp`` is the baseline's front end."""

    manifold: FrontendConfig = MANIFOLD_SLAM
    segmentation: SegmentationConfig = field(default_factory=lambda: SegmentationConfig(least_steps=5))
    htms: AlignConfig = field(default_factory=lambda: AlignConfig(method="htms"))
    icp: FrontendConfig = field(default_factory=_icp)
    frontend: FrontendConfig = field(default_factory=FrontendConfig)
    loops: LoopConfig = field(default_factory=LoopConfig)
    bundle: BundleConfig = field(default_factory=BundleConfig)
