"""Metrics of methods against truth or known relations.

A metric is an entry in the ``DEFINITIONS`` of one of the modules here and a value of its ``…_metrics``.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

from scenarios.evaluation import maps, relations, segmentation, self_consistency, trajectory
from scenarios.evaluation.metric import Definition, Metric, Values, absent
from slam.mapping.self_consistency import SelfConsistency
from slam.recording import Recording
from stitch.mapping.estimate import Estimate, NoEstimate

_BUSY = "Other programs running on the same machine, and compilation on a first run."
COST = {
    "wall_s": Definition("s", "lower", "wall time", _BUSY),
    "scans_per_s": Definition("1/s", "higher", "scans per second of wall time", _BUSY),
    "peak_mb": Definition(
        "MB", "lower", "peak memory", "What was already in memory before the method began."
    ),
}
JUDGED = {
    **trajectory.DEFINITIONS,
    **relations.DEFINITIONS,
    **maps.DEFINITIONS,
    **self_consistency.DEFINITIONS,
    **trajectory.CONSISTENCY,
    **segmentation.DEFINITIONS,
    **trajectory.ONLINE,
}
"""Metrics of every method that has an answer."""
DEFINITIONS: dict[str, Definition] = {**JUDGED, **COST}
"""Metric name -> definition, in the order of the table."""
ANSWERED = {
    "coverage": Definition(
        "", "higher", "share of the scans that an answer has a pose for", "How good the poses are."
    )
}
"""Of what was handed in; scans that it leaves out are interpolated."""
KNOWN = {**ANSWERED, **DEFINITIONS}


def evaluate(recording: Recording, estimates: Sequence[Estimate | NoEstimate]) -> list[Metric]:
    """Every metric of every method, in the order of the methods; null where a method has no answer. Raises
    ``ValueError`` when an estimate has not one pose per scan, and when the recording's relations match
    nothing in it."""
    truth = recording.truth
    pairs, truth_map = relations.relation_pairs(recording), maps.true_map(recording)
    metrics: list[Metric] = []
    for estimate in estimates:
        if isinstance(estimate, NoEstimate):
            metrics += missing(estimate.method, JUDGED, estimate.reason)
            continue
        method, poses = estimate.method, estimate.poses
        if poses.shape != (len(recording), 3):
            raise ValueError(f"{method}: expected poses ({len(recording)}, 3), got {poses.shape}")
        metrics += to_metrics(
            method,
            trajectory.trajectory_metrics(poses, truth)
            | relations.relation_metrics(poses, recording, pairs)
            | maps.map_metrics(poses, recording, truth_map)
            | self_consistency.self_consistency_metrics(_consistency(recording, estimate))
            | trajectory.consistency_metrics(poses, estimate.covariance, truth)
            | segmentation.stitch_metrics(estimate, truth)
            | trajectory.online_metrics(estimate.online, truth),
        )
    return metrics


def _consistency(recording: Recording, estimate: Estimate) -> SelfConsistency:
    if estimate.consistency is None:
        estimate = self_consistency.with_self_consistency(estimate, recording)
    assert estimate.consistency is not None
    return estimate.consistency


def to_metrics(method: str, values: Mapping[str, float | str]) -> list[Metric]:
    """Metrics of one method from values, or reasons why there are none; unit and direction as defined."""
    metrics = []
    for name, value in values.items():
        definition = KNOWN[name]
        number, reason = (None, value) if isinstance(value, str) else (float(value), None)
        metrics.append(Metric(name, number, definition.unit, definition.better, reason, method))
    return metrics


def missing(method: str, names: Iterable[str], reason: str) -> list[Metric]:
    """Metrics of one method that cannot be computed, and why."""
    return to_metrics(method, absent(names, reason))


def cost(method: str, wall_s: float, scans: int, peak_mb: float | None) -> list[Metric]:
    """What a method took: wall time [s], scans per second, peak memory [MB], None if not measured."""
    values: Values = {
        "wall_s": wall_s,
        "scans_per_s": scans / wall_s if wall_s > 0.0 else "no time passed",
        "peak_mb": "peak memory was not measured" if peak_mb is None else peak_mb,
    }
    return to_metrics(method, values)
