"""Several measures of confidence as one: the odds that a step is lost, by logistic regression.

The weights are learnt, by ``python -m scenarios.ablate confidence``, from drives through other scenarios than
those that the measures are compared on, with other seeds.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from slam.se2 import Array

LOGARITHMIC = ("trace2", "det2", "a_opt", "d_opt", "e_opt", "residual_rms", "residual_p90", "innovation")
"""Measures whose logarithm is weighed: they span many decades."""

LEAST = 1e-12
"""What a measure counts at least before its logarithm is taken."""

WEIGHTS: dict[str, float] = {
    "innovation": 2.394,
    "neg_match_share": 2.243,
    "e_opt": 0.5139,
}
BIAS = -7.982


def feature(name: str, values: Array) -> Array:
    """A measure's values ``(N,)`` as they are weighed."""
    return np.log(np.maximum(values, LEAST)) if name in LOGARITHMIC else values


def log_odds(table: Mapping[str, Array]) -> Array:
    """Logarithm ``(N,)`` of the odds that each step is lost, from the measures in `WEIGHTS`."""
    parts = [weight * feature(name, table[name]) for name, weight in WEIGHTS.items()]
    return BIAS + np.sum(parts, axis=0)
