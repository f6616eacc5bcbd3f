"""stitches.json: every pair of submaps that a method tried to align, written and read back."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from scenarios.evaluation.segmentation import stitch_error
from slam.se2 import Array
from stitch.align import Alternative, NoStitch, Prior, Stitch
from stitch.mapping.estimate import Estimate, LoopCandidate


def stitch_to_json(estimate: Estimate, candidate: LoopCandidate, truth: Array | None) -> dict[str, object]:
    """An entry of stitches.json: the pair and its prior, then the alignment, or why there is none; against
    ``truth (N, 3)`` also its error and whether it is false.

    ``scan`` is the last scan of b: in round (``turn``) 0 nothing later was known.
    """
    entry: dict[str, object] = {
        "a": candidate.a,
        "b": candidate.b,
        "turn": candidate.round,
        "scan": estimate.submaps[candidate.b].stop - 1,
        "prior": candidate.prior,
        "accepted": candidate.accepted,
        "weight": candidate.weight,
    }
    result = candidate.result
    if isinstance(result, NoStitch):
        return {**entry, "reason": result.reason, "best": result.best}
    entry |= {
        "T_a_b": result.T_a_b,
        "covariance": result.covariance,
        "score": result.score,
        "overlap_m2": result.overlap_area,
        "agreement": result.agreement,
        "belief": result.belief,
        "alternatives": result.alternatives,
    }
    error = None if truth is None else stitch_error(estimate, candidate, truth)
    if error is not None:
        entry |= {"error_m": error.translation, "error_deg": float(np.degrees(error.rotation))}
        entry["false"] = candidate.accepted and error.false
    return entry


def stitch_from_json(entry: Mapping[str, Any]) -> LoopCandidate:
    """The candidate that `stitch_to_json` wrote. Raises ``KeyError`` for an entry without all of it."""
    prior = entry["prior"]
    result: Stitch | NoStitch
    if "T_a_b" in entry:
        result = Stitch(
            np.array(entry["T_a_b"]),
            None if entry["covariance"] is None else np.array(entry["covariance"]),
            entry["score"],
            entry["overlap_m2"],
            entry["agreement"],
            tuple(map(_alternative, entry["alternatives"])),
            entry["belief"],
        )
    else:
        result = NoStitch(entry["reason"], None if entry["best"] is None else _alternative(entry["best"]))
    if prior is not None:
        prior = Prior(np.array(prior["T_a_b"]), np.array(prior["covariance"]))
    return LoopCandidate(entry["a"], entry["b"], result, entry["weight"], entry["turn"], prior)


def _alternative(entry: Mapping[str, Any]) -> Alternative:
    return Alternative(np.array(entry["T_a_b"]), float(entry["score"]))
