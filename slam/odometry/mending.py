"""The front end for odometry that may lie: tracked as it is, mended, or doubted, as the matches demand."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from slam.odometry.odometry_faults import OdometryFaultConfig, OdometryFaults, find_faults
from slam.odometry.recovering_tracker import is_contradicted, track_recovering
from slam.odometry.recovery import RecoveryConfig
from slam.odometry.track import Track
from slam.odometry.tracker import FrontendConfig, track
from slam.recording import Recording
from slam.scan import Scan, scans_of


@dataclass(frozen=True)
class MendedDrive:
    """A recording whose odometry was corrected by its ``faults`` (None: left as it is), and its track."""

    recording: Recording
    track: Track
    faults: OdometryFaults | None = None


def track_mended(
    recording: Recording,
    frontend: FrontendConfig,
    recovery: RecoveryConfig,
    config: OdometryFaultConfig,
    scans: Sequence[Scan] | None = None,
) -> MendedDrive:
    """A drive tracked by ``frontend``; where its matches contradict a wheel odometry, with that corrected by
    what is wrong with it throughout, and where they still do, with its steps doubted.

    An INS's position is better than what a tilted laser makes of it: it is believed.
    """
    plain = track(recording, frontend, scans)
    if recording.source != "odometry" or not is_contradicted(plain, recovery):
        return MendedDrive(recording, plain)
    scans = scans_of(recording, frontend.scan) if scans is None else scans
    doubting = track_recovering(recording, frontend, recovery, scans)
    faults = find_faults(recording, doubting, config)
    if not faults:
        return MendedDrive(recording, doubting)
    mended = faults.corrected(recording)
    plain = track(mended, frontend, scans)
    if not is_contradicted(plain, recovery):
        return MendedDrive(mended, plain, faults)
    return MendedDrive(mended, track_recovering(mended, frontend, recovery, scans), faults)
