"""Whether a method's map agrees with itself: the one metric that needs no truth."""

from __future__ import annotations

from dataclasses import replace

from scenarios.evaluation.metric import Definition, Values
from slam.mapping.self_consistency import SelfConsistency, SelfConsistencyConfig, self_consistency
from slam.recording import Recording
from stitch.mapping.estimate import Estimate

DEFAULT = SelfConsistencyConfig()
DEFINITIONS = {
    "self_consistency": Definition(
        "",
        "higher",
        "0 torn … 1 agrees with itself, told without truth",
        "Bends that no second pass contradicts, shifts along walls that look alike, and that a drive came "
        "back where its map has it elsewhere.",
    )
}


def with_self_consistency(
    estimate: Estimate, recording: Recording, config: SelfConsistencyConfig = DEFAULT
) -> Estimate:
    """The estimate with whether its map agrees with itself, its laser being where it was found to sit."""
    mount = estimate.laser_mount
    if mount is not None:
        recording = recording.with_laser_mount(mount.T_robot_laser)
    return replace(estimate, consistency=self_consistency(recording, estimate.poses, config))


def self_consistency_metrics(consistency: SelfConsistency) -> Values:
    """The figure, or why there is none."""
    return {"self_consistency": consistency.reason if consistency.figure is None else consistency.figure}
