"""Every stitch that a method tried, with the evidence for it, as the page reads it."""

from __future__ import annotations

import numpy as np

from scenarios.evaluation.segmentation import stitch_error
from scenarios.report.alignment_evidence import (
    AlignedPair,
    AxisSpectra,
    Walls,
    axis_spectra,
    rotation_correlation,
    score_surface,
    state_of,
)
from scenarios.report.live.encode import pack, pack_share, rounded
from scenarios.report.method_attributes import MERGING
from slam.se2 import Array
from stitch.alignment.config import AlignConfig
from stitch.alignment.result import Prior, Stitch
from stitch.mapping.estimate import Estimate, LoopCandidate


def stitch_entries(estimate: Estimate, truth: Array | None, config: AlignConfig) -> list[dict[str, object]]:
    """Every stitch a method tried, in the order of trying; with errors against ``truth (N, 3)``."""
    return [_entry(estimate, stitch, truth, config) for stitch in estimate.stitches]


def _entry(
    estimate: Estimate, stitch: LoopCandidate, truth: Array | None, config: AlignConfig
) -> dict[str, object]:
    pair = AlignedPair.of(estimate, stitch)
    error = None if truth is None else stitch_error(estimate, stitch, truth)
    entry: dict[str, object] = {
        "a": stitch.a,
        "b": stitch.b,
        "merges": estimate.method in MERGING,
        "state": state_of(stitch, None if error is None else error.false),
        "reason": None if isinstance(stitch.result, Stitch) else stitch.result.reason,
        "weight": stitch.weight,
        "prior": None if stitch.prior is None else _prior(stitch.prior),
        "before": rounded(pair.before),
        "T": None if pair.T_a_b is None else rounded(pair.T_a_b),
        "error": None if error is None else [error.translation, float(np.degrees(error.rotation))],
    }
    if isinstance(stitch.result, Stitch):
        entry |= _measures(stitch.result)
    if pair.T_a_b is not None and pair.complete:
        entry["evidence"] = _evidence(pair.a, pair.b, pair.T_a_b, config)
    return entry


def _prior(prior: Prior) -> list[float]:
    """Where b was expected, and the standard deviations of that."""
    return rounded([*prior.T_a_b, *np.sqrt(np.diag(prior.covariance))])


def _measures(stitch: Stitch) -> dict[str, object]:
    sigma = None if stitch.covariance is None else rounded(np.sqrt(np.diag(stitch.covariance)))
    return {
        "belief": stitch.belief,
        "score": stitch.score,
        "overlap": stitch.overlap_area,
        "agreement": stitch.agreement,
        "sigma": sigma,
        "rivals": [[*rounded(other.T_a_b), round(other.score, 3)] for other in stitch.alternatives[:5]],
    }


def _evidence(a: Walls, b: Walls, T_a_b: Array, config: AlignConfig) -> dict[str, object]:
    evidence: dict[str, object] = {
        "spectra": [pack_share(walls.spectrum) for walls in (a, b)],
        "correlation": pack_share(rotation_correlation(a, b)),
        "axes": [_axis(axis) for axis in axis_spectra(a, b, T_a_b)],
        "surface": None,
    }
    surface = score_surface(a, b, T_a_b, config)
    if surface is not None and surface.agreement.size:
        score = surface.score(config.search.lenient_penalty)
        low, top = float(np.median(score)), float(score.max())
        evidence["surface"] = {
            "first": rounded(surface.first),
            "step": surface.resolution,
            "width": score.shape[1],
            "values": pack_share(np.clip((score - low) / max(top - low, 1e-9), 0.0, 1.0)),
        }
    return evidence


def _axis(axis: AxisSpectra) -> dict[str, object]:
    share = axis.correlation / max(float(axis.correlation.max()), 1.0)
    return {
        "a": [round(axis.first_a, 3), pack(axis.a, "u2")],
        "b": [round(axis.first_b, 3), pack(axis.b, "u2")],
        "correlation": [round(axis.first_shift, 3), pack_share(share)],
        "shift": round(axis.shift, 3),
    }
