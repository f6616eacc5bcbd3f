"""Measures of how sure the front end is of a step: one function each, larger = worse."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from slam.se2 import Array


@dataclass(frozen=True)
class Evidence:
    """What the matcher left behind for N scans.

    ``covariance (N, 3, 3)`` of each step, NaN where there is none; ``matches (N,)``; ``tried (N,)`` True
    where a match was attempted; ``failed (N,)`` True where it gave no answer.
    """

    covariance: Array
    matches: np.ndarray
    tried: np.ndarray
    failed: np.ndarray


def trace2(evidence: Evidence) -> Array:
    """Trace [m²] of the position block of the covariance (Visser et al.; the report's first measure)."""
    return np.abs(evidence.covariance[:, 0, 0] + evidence.covariance[:, 1, 1])


def det2(evidence: Evidence) -> Array:
    """Determinant [m⁴] of the position block (Slamet and Pfingsthorn; the report's second measure)."""
    P = evidence.covariance
    return np.abs(P[:, 0, 0] * P[:, 1, 1] - P[:, 0, 1] * P[:, 1, 0])


def neg_matches(evidence: Evidence) -> Array:
    """Minus the number of matched points (the report's third measure)."""
    return -evidence.matches.astype(np.float64)


MEASURES: dict[str, Callable[[Evidence], Array]] = {
    measure.__name__: measure for measure in (trace2, det2, neg_matches)
}


def columns(evidence: Evidence) -> dict[str, Array]:
    """Every measure as a column ``(N,)``: +inf where a match was tried and failed, NaN where none was
    tried."""
    table = {}
    for name, measure in MEASURES.items():
        values = np.where(evidence.failed, np.inf, measure(evidence))
        table[name] = np.where(evidence.tried, values, np.nan)
    return table
