"""What the measures need to be told: weights of their combination, and where each is called lost."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from scipy.optimize import minimize

from scenarios.ablate.segmentation.drive import Steps
from scenarios.evaluation.detection import best_threshold
from slam.odometry.combination import feature
from slam.odometry.confidence import MEASURES
from slam.se2 import Array

COMBINED = "combined"
FEATURES = ("innovation", "neg_match_share", "e_opt")
"""What is combined: dead reckoning's view, how much of the scan was found again, and what the covariance
says."""

RULES = ("zero_match", "zero_run2")
"""The report's own: they call what they call, whatever would be better."""

PENALTY = 1.0
"""Of the squared weights of standardised features."""

Examples = Mapping[str, Sequence[Steps]]
"""Drives by scenario."""


def fitted(examples: Examples) -> tuple[dict[str, float], float]:
    """Weights and bias of the combination, by logistic regression on the steps with a match.

    Every scenario weighs alike, however many steps it has. Raises ``ValueError`` where none or all are lost.
    """
    X, lost, weights = _table(examples)
    if not lost.any() or lost.all():
        raise ValueError("expected lost steps and others, found one kind only")
    mean, spread = X.mean(axis=0), X.std(axis=0)
    Z = (X - mean) / spread

    def loss(beta: Array) -> tuple[float, Array]:
        odds = Z @ beta[:-1] + beta[-1]
        value = np.sum(weights * (np.logaddexp(0.0, odds) - lost * odds))
        off = weights * (1.0 / (1.0 + np.exp(-odds)) - lost)
        slope = np.append(Z.T @ off + PENALTY * beta[:-1], off.sum())
        return float(value + 0.5 * PENALTY * np.sum(beta[:-1] ** 2)), slope

    beta = minimize(loss, np.zeros(len(FEATURES) + 1), jac=True).x
    slopes = beta[:-1] / spread
    return dict(zip(FEATURES, slopes.tolist(), strict=True)), float(beta[-1] - slopes @ mean)


def combined(steps: Steps, weights: Mapping[str, float], bias: float) -> Array:
    """The combination ``(M,)`` with other weights than those in the code; +inf where nothing matched."""
    odds, matched = np.full(len(steps.error), np.inf), steps.matched
    parts = (weight * feature(name, steps.columns[name][matched]) for name, weight in weights.items())
    odds[matched] = bias + sum(parts)
    return odds


def thresholds(examples: Examples, weights: Mapping[str, float], bias: float) -> dict[str, float]:
    """Of every measure that could be measured, the threshold of the best F1 over all steps; scenarios weigh
    alike."""
    found = {}
    for name in MEASURES:
        if name in RULES:
            found[name] = float("inf")
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
            found[name] = best_threshold(np.concatenate(values), np.concatenate(lost), np.concatenate(counts))
    return found


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
