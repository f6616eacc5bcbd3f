"""Training of the measures: weights of their combination, and the threshold of each."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from scenarios.ablate.classifiers import fit_logistic
from scenarios.ablate.segmentation.drive import Steps
from scenarios.evaluation.detection import best_threshold
from slam.odometry.combination import feature
from slam.odometry.confidence import MEASURES
from slam.se2 import Array

COMBINED = "combined"
FEATURES = ("innovation", "neg_match_share", "e_opt")
"""The measures that are combined: of dead reckoning, of the matched points, and of the covariance."""

RULES = ("zero_match", "zero_run2")
"""Formsma's own rules: they have no threshold to learn."""

Examples = Mapping[str, Sequence[Steps]]
"""Drives by scenario."""


def fit_combination(examples: Examples) -> tuple[dict[str, float], float]:
    """Weights and bias of the combination, by logistic regression on the standardised measures of the
    steps with a match.

    Every scenario weighs alike, however many steps it has. Raises ``ValueError`` where none or all are lost.
    """
    X, lost, weights = _table(examples)
    if not lost.any() or lost.all():
        raise ValueError("expected lost steps and others, found one kind only")
    mean, spread = X.mean(axis=0), X.std(axis=0)
    slopes, bias = fit_logistic((X - mean) / spread, lost, weights)
    slopes = slopes / spread
    return dict(zip(FEATURES, slopes.tolist(), strict=True)), float(bias - slopes @ mean)


def combined(steps: Steps, weights: Mapping[str, float], bias: float) -> Array:
    """The combination ``(M,)`` with other weights than those in the code; +inf where nothing matched."""
    odds, matched = np.full(len(steps.error), np.inf), steps.matched
    parts = (weight * feature(name, steps.columns[name][matched]) for name, weight in weights.items())
    odds[matched] = bias + sum(parts)
    return odds


def learn_thresholds(examples: Examples, weights: Mapping[str, float], bias: float) -> dict[str, float]:
    """The threshold of the best F1 over all steps, of every measure that was measured; scenarios weigh
    alike."""
    best = {}
    for name in MEASURES:
        if name in RULES:
            best[name] = float("inf")
            continue
        values, lost, counts = [], [], []
        for drives in examples.values():
            total = sum(len(steps.error) for steps in drives)
            for steps in drives:
                column = combined(steps, weights, bias) if name == COMBINED else steps.columns[name]
                if np.isnan(column).any():
                    continue
                values.append(column)
                lost.append(steps.lost)
                counts.append(np.full(len(column), 1.0 / total))
        if values:
            best[name] = best_threshold(np.concatenate(values), np.concatenate(lost), np.concatenate(counts))
    return best


def _table(examples: Examples) -> tuple[Array, np.ndarray, Array]:
    """Features, what was lost, and weights that sum to the number of steps."""
    rows, lost, weights = [], [], []
    for drives in examples.values():
        kept = [steps.matched for steps in drives]
        total = sum(int(part.sum()) for part in kept)
        for steps, part in zip(drives, kept, strict=True):
            rows.append(np.stack([feature(name, steps.columns[name][part]) for name in FEATURES], axis=1))
            lost.append(steps.lost[part])
            weights.append(np.full(int(part.sum()), 1.0 / total))
    share = np.concatenate(weights)
    return np.concatenate(rows), np.concatenate(lost), share * len(share) / share.sum()
