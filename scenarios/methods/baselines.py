"""What ours is compared with: dead reckoning, ICP, and ManifoldSLAM as the thesis ran it."""

from __future__ import annotations

from scenarios.methods.config import MethodConfig
from slam.odometry.tracker import track
from slam.recording import Recording
from stitch.mapping.estimate import Estimate


def ins(recording: Recording, config: MethodConfig) -> Estimate:
    """Dead reckoning exactly as recorded."""
    return Estimate("ins", recording.dead_reckoning)


def icp(recording: Recording, config: MethodConfig) -> Estimate:
    """Unweighted point-to-point ICP, scan to scan, in our front end."""
    tracked = track(recording, config.icp)
    return Estimate("icp", tracked.poses, track=tracked)


def wsm(recording: Recording, config: MethodConfig) -> Estimate:
    """ManifoldSLAM with the Weighted Scan Matcher, as the thesis ran it."""
    tracked = track(recording, config.manifold)
    return Estimate("wsm", tracked.poses, track=tracked)
