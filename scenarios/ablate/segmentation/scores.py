"""Scores of every measure on every drive, and numbers of the maps that it cuts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import rankdata

from scenarios.ablate.segmentation.drive import Steps
from scenarios.ablate.segmentation.learning import RULES
from scenarios.ablate.segmentation.trials import DETECTION
from scenarios.evaluation.detection import Decision, average_precision, decided, roc_auc, spearman
from scenarios.sweep import Answer, Trial
from slam.odometry.segmentation import THRESHOLDS
from slam.se2 import Array

SCORES = {
    "auc": "chance that a lost step scores worse than another one, all steps",
    "auc_matched": "the same, of the steps with at least one match",
    "ap": "average precision, all steps",
    "ap_matched": "the same, of the steps with at least one match",
    "precision": "share of the steps called lost that were",
    "recall": "share of the lost steps that were called",
    "f1": "harmonic mean of the two",
    "spearman_error": "rank correlation with the true error, steps with at least one match",
}
"""Score of a measure on a drive -> what it is."""

DOWNSTREAM = {
    "pieces": "pieces the drive was cut into",
    "kept": "share of the scans in a piece",
    "pure": "share of those in a piece without a lost step or drift as large",
    "drift": "largest error inside a piece, mean over scans [m]",
    "ate_rmse": "position error of the final trajectory [m]",
    "map_f1": "share of the final map's walls that is right",
    "seconds": "processor time of the map [s]",
}
"""Number of a cut drive -> what it is."""


@dataclass(frozen=True)
class ScoredDrive:
    """All results of one drive: its steps, what each cutter made of it, and how often slamstitch's own front
    end was lost."""

    scenario: str
    seed: int
    steps: Steps
    cuts: Mapping[str, Mapping[str, float]]
    steps_ours: int
    lost_ours: int


def collect_drives(answered: Sequence[tuple[Trial, Answer]]) -> list[ScoredDrive]:
    """The drives whose detection has a result, in the trials' order."""
    detected: dict[tuple[str, int], Answer] = {}
    cuts: dict[tuple[str, int], dict[str, Mapping[str, float]]] = {}
    for trial, answer in answered:
        if trial.method == DETECTION:
            detected[trial.drive] = answer
        else:
            cuts.setdefault(trial.drive, {})[trial.method] = answer.rows[0]
    return [
        ScoredDrive(
            *place,
            Steps.from_bytes(answer.payload),
            cuts.get(place, {}),
            int(answer.rows[0]["steps_ours"]),
            int(answer.rows[0]["lost_ours"]),
        )
        for place, answer in detected.items()
    ]


def decision(steps: Steps, name: str) -> Decision | None:
    """The steps that a measure calls lost at its threshold against those that were; None where it has no
    threshold or was not measured."""
    measured = steps.of(name, np.ones(len(steps.error), dtype=bool))
    if measured is None or name not in THRESHOLDS:
        return None
    values, lost = measured
    return decided(np.isposinf(values) | (values > THRESHOLDS[name]), lost)


def score_measure(steps: Steps, name: str) -> dict[str, float]:
    """The `SCORES` of a measure on one drive; NaN where there is none."""
    nothing = dict.fromkeys(SCORES, float("nan"))
    everything, matched = steps.of(name, np.ones(len(steps.error), dtype=bool)), steps.of(name, steps.matched)
    if everything is None or matched is None:
        return nothing
    called = decision(steps, name)
    about_matched = {
        "auc_matched": roc_auc(*matched),
        "ap_matched": average_precision(*matched),
        "spearman_error": spearman(matched[0], steps.error[steps.matched]),
    }
    return {
        **nothing,
        "auc": roc_auc(*everything),
        "ap": average_precision(*everything),
        **({} if name in RULES else about_matched),
        **({} if called is None else {key: getattr(called, key) for key in ("precision", "recall", "f1")}),
    }


def score_table(drives: Sequence[ScoredDrive], names: Sequence[str]) -> dict[str, dict[str, Array]]:
    """Score or number -> measure or cutter -> its values ``(n,)`` over the drives; NaN where there is
    none."""
    values: dict[str, dict[str, Array]] = {}
    for name in names:
        rows = [score_measure(drive.steps, name) for drive in drives]
        for score in SCORES:
            values.setdefault(score, {})[name] = np.array([row[score] for row in rows])
    cutters = dict.fromkeys(cutter for drive in drives for cutter in drive.cuts)
    for number in DOWNSTREAM:
        values[number] = {
            cutter: np.array(
                [drive.cuts.get(cutter, {}).get(number, np.nan) for drive in drives], dtype=np.float64
            )
            for cutter in cutters
        }
    return values


def pooled_decision(drives: Sequence[ScoredDrive], name: str) -> Decision | None:
    """The decisions of all drives together; None where a measure has none."""
    made = [one for drive in drives if (one := decision(drive.steps, name)) is not None]
    return sum(made[1:], made[0]) if made else None


def correlations(drives: Sequence[ScoredDrive], names: Sequence[str]) -> Array:
    """Spearman's correlation of all measures with each other, and with the true error in the last row and
    column: mean over drives, all steps; NaN where one was never measured or constant."""
    matrices = []
    for drive in drives:
        columns = [*(drive.steps.columns[name] for name in names), drive.steps.error]
        ranks = rankdata(columns, axis=1)  # NaN throughout where one value is NaN
        usable = np.ptp(ranks, axis=1) > 0.0
        matrix = np.full((len(ranks), len(ranks)), np.nan)
        if usable.any():
            matrix[np.ix_(usable, usable)] = np.corrcoef(ranks[usable])
        matrices.append(matrix)
    several = np.stack(matrices)
    counts = np.isfinite(several).sum(axis=0)
    return np.where(counts > 0, np.nansum(several, axis=0) / np.maximum(counts, 1), np.nan)
