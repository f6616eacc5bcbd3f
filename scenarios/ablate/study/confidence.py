"""What the confidence measures need to be told: weights of their combination, and thresholds."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from itertools import product

import numpy as np

from scenarios.ablate.options import ConfidenceOptions
from scenarios.ablate.segmentation.findings import RULES
from scenarios.ablate.segmentation.trials import LabelledDrive, Steps, label_drive, steps_of
from scenarios.ablate.training import fit_logistic, require
from scenarios.evaluation.detection import best_threshold
from scenarios.sweep import Answer, Trial, finish
from slam.cli import InputError
from slam.odometry.combination import feature
from slam.odometry.confidence import MEASURES
from slam.se2 import Array

COMBINED = "combined"
FEATURES = ("innovation", "neg_match_share", "e_opt")
"""The measures that are combined: of dead reckoning, of the matched points, and of the covariance."""

Examples = Mapping[str, Sequence[Steps]]
"""Drives by scenario."""


def run(options: ConfidenceOptions) -> None:
    """Drive, fit, and print what is to stand in the code."""
    scenarios, seeds = options.checked_for_training()
    require()
    trials = [Trial("confidence", name, seed, "wsm") for name, seed in product(scenarios, seeds)]
    swept = options.sweep(trials, measure_steps, prepare=label_drive)
    examples: dict[str, list[Steps]] = {name: [] for name in scenarios}
    for trial, result in swept.answered:
        steps = Steps.from_bytes(result.payload)
        lost = f"{steps.lost.sum()} of {len(steps.error)} steps lost"
        print(f"{trial.scenario} {trial.seed}: {lost}", file=sys.stderr)
        examples[trial.scenario].append(steps)
    try:
        weights, bias = fit_combination(examples)
    except ValueError as error:
        raise InputError(f"--seeds {options.seeds}: {error}") from error
    print(f"WEIGHTS = {_literal(weights)}\nBIAS = {bias:.3f}\n")
    print(f"THRESHOLDS = {_literal(learn_thresholds(examples, weights, bias))}")
    finish(swept, options.store)


def measure_steps(trial: Trial, drive: LabelledDrive) -> Answer:
    """The steps of a simulated drive, as the payload."""
    return Answer([], steps_of(drive.recording, drive.track).to_bytes())


def fit_combination(examples: Examples) -> tuple[dict[str, float], float]:
    """Weights and bias of the combination by logistic regression on the standardised measures of steps with a
    match, scenarios weighing alike. Raises ``ValueError`` where none or all are lost."""
    features, lost, weights = [], [], []
    for drives in examples.values():
        total = sum(int(steps.matched.sum()) for steps in drives)
        for steps in drives:
            part = steps.matched
            features.append(np.stack([feature(name, steps.columns[name][part]) for name in FEATURES], axis=1))
            lost.append(steps.lost[part])
            weights.append(np.full(int(part.sum()), 1.0 / total))
    X, positive, share = np.concatenate(features), np.concatenate(lost), np.concatenate(weights)
    if not positive.any() or positive.all():
        raise ValueError("expected lost steps and others, found one kind only")
    mean, spread = X.mean(axis=0), X.std(axis=0)
    slopes, bias = fit_logistic((X - mean) / spread, positive, share * len(share) / share.sum())
    slopes = slopes / spread
    return dict(zip(FEATURES, slopes.tolist(), strict=True)), float(bias - slopes @ mean)


def combined(steps: Steps, weights: Mapping[str, float], bias: float) -> Array:
    """The combination ``(M,)`` with other weights than those in the code; +inf where nothing matched."""
    odds, matched = np.full(len(steps.error), np.inf), steps.matched
    parts = (weight * feature(name, steps.columns[name][matched]) for name, weight in weights.items())
    odds[matched] = bias + sum(parts)
    return odds


def learn_thresholds(examples: Examples, weights: Mapping[str, float], bias: float) -> dict[str, float]:
    """The threshold of the best F1 over all steps, of each measure that was measured; scenarios alike."""
    best = {}
    for name in MEASURES:
        if name in RULES:
            best[name] = float("inf")
            continue
        rows = []
        for drives in examples.values():
            total = sum(len(steps.error) for steps in drives)
            for steps in drives:
                column = combined(steps, weights, bias) if name == COMBINED else steps.columns[name]
                if not np.isnan(column).any():
                    rows.append((column, steps.lost, np.full(len(column), 1.0 / total)))
        if rows:
            best[name] = best_threshold(*(np.concatenate(column) for column in zip(*rows, strict=True)))
    return best


def _literal(numbers: dict[str, float]) -> str:
    """A dictionary of numbers as Python reads it."""
    lines = [
        f'    "{name}": ' + ("np.inf" if value == float("inf") else f"{value:.4g}") + ","
        for name, value in numbers.items()
    ]
    return "\n".join(["{", *lines, "}"])
