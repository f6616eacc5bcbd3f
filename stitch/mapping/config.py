"""Every setting of the SLAM that is made of stitched submaps, in one tree."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from slam.graph.odometry_factors import OdometryFactorConfig
from slam.mapping.keyframes import KeyframeConfig
from slam.odometry.ego_motion_filter import EgoMotionFilterConfig
from slam.odometry.laser_mount import LaserMountConfig
from slam.odometry.mending import MendingConfig
from slam.odometry.segmentation import SegmentationConfig
from slam.odometry.tracker import FrontendConfig
from stitch.mapping.bundle import BundleConfig
from stitch.mapping.estimate import RejectionConfig
from stitch.mapping.submap_graph import LoopConfig
from stitch.mapping.submaps import SubmapConfig


@dataclass(frozen=True)
class OnlineConfig:
    """What differs scan by scan."""

    neighbours: int = 6
    """Keyframes that each is matched to: with more, updates take long."""
    per_pass: int = 3
    """Those of them of one stretch of the drive."""
    radii: tuple[float, ...] = (0.3, 0.2, 0.15, 0.15)
    """Correspondence distances [m] of the rounds of these matches."""
    max_shift: float = 0.3
    """A match that leaves its guess by more [m] has found something else …"""
    max_turn: float = np.radians(6.0)
    """… or by more [rad]."""
    match_distance: float = 15.0
    """Metres of graph distance up to which two submaps are placed well enough for their scans to be
    matched."""
    max_innovation: float = 11.345
    """A stitch farther from where the graph expects it, χ²₃(0.99), makes the graph judge all anew."""
    tilt_window: int = 31
    """Scans of the running median of the tilt: of the past alone, a longer one would always be late."""
    loss_window: int = 10
    """Scans from which is told whether confidence is lost at the last of them."""
    settling_updates: int = 2
    """Updates of iSAM2 after which a loop that moved the graph has settled."""
    relinearise: float = 0.05
    """A pose that moved this far (m, rad) since it was linearised is linearised anew."""


@dataclass(frozen=True)
class MappingConfig:
    """Settings of `map_recording` and `OnlineMapper`, stage by stage."""

    mount: LaserMountConfig = field(default_factory=LaserMountConfig)
    """Where the laser sits, if nobody states it."""
    mending: MendingConfig = field(default_factory=MendingConfig)
    """What is made of a wheel odometry that is worse or better than it says."""
    ego_motion_filter: EgoMotionFilterConfig = field(default_factory=EgoMotionFilterConfig)
    """What moves with the robot."""
    frontend: FrontendConfig = field(default_factory=FrontendConfig)
    """Tracking scan by scan."""
    segmentation: SegmentationConfig = field(default_factory=lambda: SegmentationConfig(least_steps=5))
    """Where the drive is cut."""
    keyframes: KeyframeConfig = field(default_factory=KeyframeConfig)
    """Which scans stand for the drive."""
    submaps: SubmapConfig = field(default_factory=SubmapConfig)
    """How stretches become submaps."""
    odometry: OdometryFactorConfig = field(default_factory=OdometryFactorConfig)
    """How far the steps of the track are believed."""
    loops: LoopConfig = field(default_factory=LoopConfig)
    """Loop closure."""
    bundle: BundleConfig = field(default_factory=BundleConfig)
    """Bundle adjustment of keyframes and remaining scans."""
    rejection: RejectionConfig = field(default_factory=RejectionConfig)
    """When a map made by the laser alone is refused."""
    online: OnlineConfig = field(default_factory=OnlineConfig)
    """What differs scan by scan."""
