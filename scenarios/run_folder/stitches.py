"""segments.json and stitches.json: how each method cut the drive, and the story of every stitch."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from scenarios.evaluation.stitches import stitch_error
from slam.se2 import Array
from stitch.align import Alternative, Prior, Stitch
from stitch.mapping.estimate import Estimate, LoopCandidate


def segments(estimates: Sequence[Estimate]) -> dict[str, list[dict[str, int]]]:
    """Method -> its segments, scans ``start..stop-1`` each."""
    return {
        estimate.method: [{"start": submap.start, "stop": submap.stop} for submap in estimate.submaps]
        for estimate in estimates
        if estimate.submaps
    }


def stories(estimates: Sequence[Estimate], truth: Array | None) -> dict[str, list[dict[str, object]]]:
    """Method -> every stitch it tried; against ``truth (N, 3)`` also how far off and whether false."""
    return {
        estimate.method: [story(estimate, tried, truth) for tried in estimate.stitches]
        for estimate in estimates
        if estimate.stitches
    }


def story(estimate: Estimate, tried: LoopCandidate, truth: Array | None) -> dict[str, object]:
    """What came of a pair of segments: when it was tried and where it was expected, the alignment and what
    speaks for it, or why there is none.

    ``scan`` is the last scan of b: in round (``turn``) 0 nothing later was known.
    """
    told: dict[str, object] = {
        "a": tried.a,
        "b": tried.b,
        "turn": tried.round,
        "scan": estimate.submaps[tried.b].stop - 1,
        "prior": None if tried.prior is None else _prior(tried.prior),
        "accepted": tried.accepted,
        "weight": tried.weight,
    }
    result = tried.result
    if not isinstance(result, Stitch):
        best = None if result.best is None else _alternative(result.best)
        return {**told, "reason": result.reason, "best": best}
    told |= {
        "T_a_b": result.T_a_b,
        "covariance": result.covariance,
        "score": result.score,
        "overlap_m2": result.overlap_area,
        "agreement": result.agreement,
        "belief": result.belief,
        "alternatives": [_alternative(other) for other in result.alternatives],
    }
    error = None if truth is None else stitch_error(estimate, tried, truth)
    if error is not None:
        told |= {"error_m": error.translation, "error_deg": float(np.degrees(error.rotation))}
        told["false"] = tried.accepted and error.false
    return told


def _prior(prior: Prior) -> dict[str, object]:
    return {"T_a_b": prior.T_a_b, "covariance": prior.covariance}


def _alternative(other: Alternative) -> dict[str, object]:
    return {"T_a_b": other.T_a_b, "score": other.score}
