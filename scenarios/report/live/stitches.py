"""The story of every stitch, with what speaks for it, as the page tells it."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from scenarios.evaluation.stitches import stitch_error
from scenarios.report.evidence import Axis, Walls, axes, rotation_correlation, surface
from scenarios.report.live.packed import packed
from scenarios.report.pieces import MERGING, before, partner, piece, pose_of, state
from slam.se2 import Array
from stitch.alignment.config import AlignConfig
from stitch.alignment.result import Prior, Stitch
from stitch.mapping.estimate import Estimate, LoopCandidate


def stitches(estimate: Estimate, truth: Array | None, config: AlignConfig) -> list[dict[str, object]]:
    """Every stitch a method tried, in the order of trying."""
    walls = lru_cache(maxsize=None)(lambda k: piece(estimate, k))
    return [_stitch(estimate, tried, walls(tried.b), truth, config) for tried in estimate.stitches]


def _stitch(
    estimate: Estimate, tried: LoopCandidate, b: Walls, truth: Array | None, config: AlignConfig
) -> dict[str, object]:
    a = partner(estimate, tried)
    error = None if truth is None else stitch_error(estimate, tried, truth)
    T = pose_of(tried)
    told: dict[str, object] = {
        "a": tried.a,
        "b": tried.b,
        "merges": estimate.method in MERGING,
        "state": state(tried, None if error is None else error.false),
        "reason": None if isinstance(tried.result, Stitch) else tried.result.reason,
        "weight": tried.weight,
        "prior": None if tried.prior is None else _prior(tried.prior),
        "before": _rounded(before(estimate, tried)),
        "T": None if T is None else _rounded(T),
        "error": None if error is None else [error.translation, float(np.degrees(error.rotation))],
    }
    if isinstance(tried.result, Stitch):
        told |= _measures(tried.result)
    if T is not None and len(a.points) and len(b.points):
        told["evidence"] = _evidence(a, b, T, config)
    return told


def _prior(prior: Prior) -> list[float]:
    """Where b was expected, and the standard deviations of that."""
    return _rounded([*prior.T_a_b, *np.sqrt(np.diag(prior.covariance))])


def _measures(stitch: Stitch) -> dict[str, object]:
    sigma = None if stitch.covariance is None else np.sqrt(np.diag(stitch.covariance))
    return {
        "belief": stitch.belief,
        "score": stitch.score,
        "overlap": stitch.overlap_area,
        "agreement": stitch.agreement,
        "sigma": None if sigma is None else _rounded(sigma),
        "rivals": [[*_rounded(other.T_a_b), round(other.score, 3)] for other in stitch.alternatives[:5]],
    }


def _evidence(a: Walls, b: Walls, T_a_b: Array, config: AlignConfig) -> dict[str, object]:
    told: dict[str, object] = {
        "spectra": [packed(walls.spectrum, "u1", 1 / 254) for walls in (a, b)],
        "correlation": packed(rotation_correlation(a, b), "u1", 1 / 254),
        "axes": [_axis(axis) for axis in axes(a, b, T_a_b)],
        "surface": None,
    }
    found = surface(a, b, T_a_b, config)
    if found is not None and found.agreement.size:
        score = found.score(config.search.lenient_penalty)
        low, top = float(np.median(score)), float(score.max())
        told["surface"] = {
            "first": _rounded(found.first),
            "step": found.resolution,
            "width": score.shape[1],
            "values": packed(np.clip((score - low) / max(top - low, 1e-9), 0.0, 1.0), "u1", 1 / 254),
        }
    return told


def _axis(axis: Axis) -> dict[str, object]:
    return {
        "a": [round(axis.first_a, 3), packed(axis.a, "u2")],
        "b": [round(axis.first_b, 3), packed(axis.b, "u2")],
        "correlation": [
            round(axis.first_shift, 3),
            packed(axis.correlation / max(float(axis.correlation.max()), 1.0), "u1", 1 / 254),
        ],
        "shift": round(axis.shift, 3),
    }


def _rounded(values: Array | Sequence[float]) -> list[float]:
    return [round(float(value), 5) for value in values]
