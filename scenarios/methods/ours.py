"""slamstitch, offline and online."""

from __future__ import annotations

from scenarios.methods.config import MethodConfig
from slam.recording import Recording
from stitch.mapping import Estimate, NoEstimate, map_recording, replay_online


def offline(recording: Recording, config: MethodConfig) -> Estimate | NoEstimate:
    """Local maps, cuts, joint stitching, a robust pose graph and a bundle."""
    return map_recording(recording, config.slam)


def online(recording: Recording, config: MethodConfig) -> Estimate | NoEstimate:
    """The same scan by scan: each pose from the scans until then, by iSAM2."""
    return replay_online(recording, config.slam)
