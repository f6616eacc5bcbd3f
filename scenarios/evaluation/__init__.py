"""Metrics of methods against truth or known relations."""

from __future__ import annotations

from collections.abc import Sequence

from scenarios.estimate import Estimate
from scenarios.evaluation.consistency import consistency_metrics
from scenarios.evaluation.definitions import DEFINITIONS
from scenarios.evaluation.maps import map_metrics, true_map
from scenarios.evaluation.metric import Metric, cost
from scenarios.evaluation.relations import relation_metrics, relation_pairs
from scenarios.evaluation.stitches import stitch_metrics
from scenarios.evaluation.trajectory import trajectory_metrics
from slam.recording import Recording

__all__ = ["DEFINITIONS", "Metric", "cost", "evaluate"]


def evaluate(recording: Recording, estimates: Sequence[Estimate]) -> list[Metric]:
    """Every metric of every method, in the order of the methods.

    Raises ``ValueError`` when an estimate has not one pose per scan, and when the recording's relations match
    nothing in it.
    """
    pairs, truth_map = relation_pairs(recording), true_map(recording)
    metrics: list[Metric] = []
    for estimate in estimates:
        method, poses = estimate.method, estimate.poses
        if poses.shape != (len(recording), 3):
            raise ValueError(f"{method}: expected poses ({len(recording)}, 3), got {poses.shape}")
        metrics += trajectory_metrics(method, poses, recording.truth)
        metrics += relation_metrics(method, poses, recording, pairs)
        metrics += map_metrics(method, poses, recording, truth_map)
        metrics += consistency_metrics(method, poses, estimate.covariance, recording.truth)
        metrics += stitch_metrics(estimate, recording.truth)
    return metrics
