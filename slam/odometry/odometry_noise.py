"""How exact a wheel odometry is, as the matches of its drive tell.

Along a corridor whose doors look alike the matcher slides, a little each step and always the same way, within
what wheels are usually granted. A drive's matches that are sure of their place tell how exact its wheels are;
where that is far better than usual, they hold the matches that are not.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import norm

from slam import se2
from slam.odometry.dead_reckoning import DeadReckoning, DeadReckoningConfig
from slam.odometry.track import Track, Verdict
from slam.recording import Recording

NOISE = tuple(name for name in DeadReckoningConfig.__annotations__ if name.startswith("odometry_"))
"""The settings that grow with a wheel odometry's noise."""


@dataclass(frozen=True)
class OdometryNoiseConfig:
    """When a wheel odometry is believed to be better than usual."""

    max_scale: float = 0.25
    """Its noise, as a share of the usual, up to which that is believed; 0: never. Real wheels have 0.3 to
    1.5."""
    min_scale: float = 0.1
    """Least share that is believed."""
    max_match_sigma: float = 0.005
    """A match that knows its place worse [m] tells nothing of the wheels."""
    min_motion: float = 0.01
    """A step tells something where the robot drove or turned by more [m or rad]."""
    min_steps: int = 50
    """Steps that it takes."""


def noise_scale(
    recording: Recording,
    track: Track,
    usual: DeadReckoningConfig = DeadReckoningConfig(),
    config: OdometryNoiseConfig = OdometryNoiseConfig(),
) -> float:
    """Noise of the recording's wheels as a share of the ``usual``, 1 where it is not clearly better.

    Of the residuals between matched and counted steps, each as a share of its usual standard deviation, the
    median tells, of the worst of along, sideways and turning.
    """
    matched = track.verdict == Verdict.MATCHED
    counted = se2.between(recording.dead_reckoning[:-1], recording.dead_reckoning[1:])
    moved = np.any(np.abs(counted) > config.min_motion, axis=1)
    sure = matched[:-1] & matched[1:] & (track.place_sigma[1:] < config.max_match_sigma) & moved
    steps = np.flatnonzero(sure)
    if len(steps) < config.min_steps:
        return 1.0
    residual = se2.between(counted, se2.between(track.poses[:-1], track.poses[1:]))[steps]
    covariance = DeadReckoning(recording, usual).step_covariance(steps, steps + 1)
    shares = np.abs(residual) / np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    scale = float(np.max(np.median(shares, axis=0)) / norm.ppf(0.75))
    return max(scale, config.min_scale) if scale <= config.max_scale else 1.0


def scaled(usual: DeadReckoningConfig, scale: float) -> DeadReckoningConfig:
    """The usual noise of wheels times ``scale``."""
    return replace(usual, **{name: scale * getattr(usual, name) for name in NOISE})
