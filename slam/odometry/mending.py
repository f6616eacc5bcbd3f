"""The front end for odometry that may lie: tracked as it is, mended, or doubted, as the matches demand."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

from slam.odometry.dead_reckoning import DeadReckoningConfig
from slam.odometry.odometry_faults import OdometryFaultConfig, OdometryFaults, find_faults
from slam.odometry.odometry_noise import OdometryNoiseConfig, noise_scale, scaled
from slam.odometry.recovering_tracker import is_contradicted, track_recovering
from slam.odometry.recovery import RecoveryConfig
from slam.odometry.track import Track
from slam.odometry.tracker import FrontendConfig, track
from slam.recording import Recording
from slam.scan import Scan, scans_of


@dataclass(frozen=True)
class MendingConfig:
    """What is made of a wheel odometry by what the matches say of it."""

    recovery: RecoveryConfig = field(default_factory=RecoveryConfig)
    """Tracking where matches contradict it."""
    faults: OdometryFaultConfig = field(default_factory=OdometryFaultConfig)
    """What is wrong with it throughout."""
    noise: OdometryNoiseConfig = field(default_factory=OdometryNoiseConfig)
    """When it is believed to be better than usual."""


@dataclass(frozen=True)
class MendedDrive:
    """A recording whose odometry was corrected by its ``faults`` (None: left as it is), its ``track``, and
    the noise of its dead ``reckoning``."""

    recording: Recording
    track: Track
    reckoning: DeadReckoningConfig
    faults: OdometryFaults | None = None


def track_mended(
    recording: Recording, frontend: FrontendConfig, config: MendingConfig, scans: Sequence[Scan]
) -> MendedDrive:
    """A drive mended, and where its matches find the wheels far better than usual, with that noise."""
    drive = mend(recording, frontend, config, scans)
    scale = 1.0
    if recording.source == "odometry" and not is_contradicted(drive.recording, drive.track, config.recovery):
        scale = noise_scale(drive.recording, drive.track, drive.reckoning, config.noise)
    if scale == 1.0:
        return drive
    reckoning = scaled(drive.reckoning, scale)
    exact = track(drive.recording, replace(frontend, dead_reckoning=reckoning), scans)
    return replace(drive, track=exact, reckoning=reckoning)


def mend(
    recording: Recording,
    frontend: FrontendConfig,
    config: MendingConfig,
    scans: Sequence[Scan] | None = None,
) -> MendedDrive:
    """A drive tracked by ``frontend``. Where its matches contradict a wheel odometry, with that corrected by
    what is wrong with it throughout, and where they still do, with its steps doubted.

    An INS's position is better than what a tilted laser makes of it: it is believed.
    """
    scans = scans_of(recording, frontend.scan) if scans is None else scans
    drive = MendedDrive(recording, track(recording, frontend, scans), frontend.dead_reckoning)
    if recording.source != "odometry" or not is_contradicted(recording, drive.track, config.recovery):
        return drive
    doubting = track_recovering(recording, frontend, config.recovery, scans)
    faults = find_faults(recording, doubting, config.faults)
    if not faults:
        return replace(drive, track=doubting)
    mended = faults.corrected(recording)
    plain = track(mended, frontend, scans)
    if is_contradicted(mended, plain, config.recovery):
        plain = track_recovering(mended, frontend, config.recovery, scans)
    return MendedDrive(mended, plain, frontend.dead_reckoning, faults)
