"""Metrics of methods against truth or known relations."""

from __future__ import annotations

from collections.abc import Sequence

from scenarios.evaluation.consistency import consistency_metrics
from scenarios.evaluation.definitions import DEFINITIONS
from scenarios.evaluation.live import live_metrics
from scenarios.evaluation.maps import map_metrics, true_map
from scenarios.evaluation.metric import COST, Metric, cost, missing
from scenarios.evaluation.relations import relation_metrics, relation_pairs
from scenarios.evaluation.stitches import stitch_metrics
from scenarios.evaluation.trajectory import trajectory_metrics
from slam.recording import Recording
from stitch.mapping.estimate import Estimate, NoEstimate

__all__ = ["COST", "DEFINITIONS", "Metric", "cost", "evaluate", "missing"]


JUDGED = tuple(name for name in DEFINITIONS if name not in COST)
"""Metrics of every method that has an answer."""


def evaluate(recording: Recording, estimates: Sequence[Estimate | NoEstimate]) -> list[Metric]:
    """Every metric of every method, in the order of the methods; null where a method has no answer.

    Raises ``ValueError`` when an estimate has not one pose per scan, and when the recording's relations match
    nothing in it.
    """
    pairs, truth_map = relation_pairs(recording), true_map(recording)
    metrics: list[Metric] = []
    for estimate in estimates:
        if isinstance(estimate, NoEstimate):
            metrics += missing(estimate.method, JUDGED, estimate.reason)
            continue
        method, poses = estimate.method, estimate.poses
        if poses.shape != (len(recording), 3):
            raise ValueError(f"{method}: expected poses ({len(recording)}, 3), got {poses.shape}")
        metrics += trajectory_metrics(method, poses, recording.truth)
        metrics += relation_metrics(method, poses, recording, pairs)
        metrics += map_metrics(method, poses, recording, truth_map)
        metrics += consistency_metrics(method, poses, estimate.covariance, recording.truth)
        metrics += stitch_metrics(estimate, recording.truth)
        metrics += live_metrics(method, estimate.online, recording.truth)
    return metrics
