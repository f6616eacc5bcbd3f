"""The scores of every measure on every drive and of the maps that it cuts, and what comes of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import rankdata

from scenarios.ablate.segmentation.trials import DETECTION, NEVER, TRUTH, Steps
from scenarios.ablate.statistics import NAN, Mean, PairedDifference, compare_pairs, mean_interval
from scenarios.evaluation.detection import Decision, average_precision, decided, roc_auc, spearman
from scenarios.sweep import Answer, Trial
from slam.odometry.segmentation import THRESHOLDS
from slam.se2 import Array

RULES = ("zero_match", "zero_run2")
"""Formsma's own rules: they have no threshold to learn."""
SEED = 0
"""Of the generator that intervals draw from."""


@dataclass(frozen=True)
class Score:
    """One number of a measure on a drive, or of a drive that it cut; printed where it has a ``heading``."""

    meaning: str
    heading: str = ""
    decimals: int = 3
    interval: bool = False


MATCHED = "of the steps with at least one match"
DECISION_SCORES = {
    "precision": Score("share of the steps called lost at its threshold that were", "P", 2),
    "recall": Score("share of the lost steps that were called at its threshold", "R", 2),
    "f1": Score("harmonic mean of the two", "F1", 2),
}
DETECTION_SCORES = {
    "auc": Score("chance that a lost step scores worse than another one, all steps", "AUC"),
    "auc_matched": Score(f"the same, {MATCHED}", "AUC matched", interval=True),
    "ap": Score("average precision, all steps", "AP"),
    "ap_matched": Score(f"the same, {MATCHED}", "AP matched"),
    **DECISION_SCORES,
    "spearman_error": Score(f"rank correlation with the true error, {MATCHED}", "ρ error", 2),
}
"""Scores of a measure on a drive."""
MAP_SCORES = {
    "pieces": Score("pieces the drive was cut into", "pieces", 1),
    "kept": Score("share of the scans in a piece"),
    "pure": Score("share of those in a piece without a lost step or drift as large", "pure", 2),
    "drift": Score("largest error inside a piece, mean over scans [m]"),
    "ate_rmse": Score("position error of the final trajectory [m], geometric mean", "ATE", 3, True),
    "map_f1": Score("share of the final map's walls that is right", "map F1", 3, True),
    "seconds": Score("processor time of the map [s]"),
}
"""Scores of a drive that was cut."""
SCORES = DETECTION_SCORES | MAP_SCORES


@dataclass(frozen=True)
class ScoredDrive:
    """All results of one drive: its steps, what each cutter made of it (`MAP_SCORES`), and how often
    slamstitch's own front end was lost."""

    scenario: str
    seed: int
    steps: Steps
    cuts: Mapping[str, Mapping[str, float]]
    steps_ours: int
    lost_ours: int


def collect_drives(answered: Sequence[tuple[Trial, Answer]]) -> list[ScoredDrive]:
    """The drives whose detection has a result, in the trials' order."""
    cuts: dict[tuple[str, int], dict[str, Mapping[str, float]]] = {trial.drive: {} for trial, _ in answered}
    for trial, answer in answered:
        if trial.method != DETECTION:
            cuts[trial.drive][trial.method] = answer.rows[0]
    return [
        ScoredDrive(*trial.drive, Steps.from_bytes(answer.payload), cuts[trial.drive], **answer.rows[0])
        for trial, answer in answered
        if trial.method == DETECTION
    ]


def decision(steps: Steps, name: str) -> Decision | None:
    """What a measure calls lost at its threshold against what was; None without threshold or values."""
    values = steps.columns[name]
    if name not in THRESHOLDS or np.isnan(values).any():
        return None
    return decided(np.isposinf(values) | (values > THRESHOLDS[name]), steps.lost)


def score_measure(steps: Steps, name: str) -> dict[str, float]:
    """The `DETECTION_SCORES` of a measure on one drive; NaN where there is none."""
    scores = dict.fromkeys(DETECTION_SCORES, NAN)
    values, lost, matched = steps.columns[name], steps.lost, steps.matched
    if np.isnan(values).any():
        return scores
    scores |= {"auc": roc_auc(values, lost), "ap": average_precision(values, lost)}
    if name not in RULES:
        scores["auc_matched"] = roc_auc(values[matched], lost[matched])
        scores["ap_matched"] = average_precision(values[matched], lost[matched])
        scores["spearman_error"] = spearman(values[matched], steps.error[matched])
    called = decision(steps, name)
    return scores if called is None else scores | {key: getattr(called, key) for key in DECISION_SCORES}


def score_table(drives: Sequence[ScoredDrive], names: Sequence[str]) -> dict[str, dict[str, Array]]:
    """Score -> measure or cutter -> its values ``(n,)`` over the drives; NaN where there is none."""
    rows = {name: [score_measure(drive.steps, name) for drive in drives] for name in names}
    cutters = dict.fromkeys(cutter for drive in drives for cutter in drive.cuts)
    cut = {cutter: [drive.cuts.get(cutter, {}) for drive in drives] for cutter in cutters}
    return {
        score: {
            name: np.array([row.get(score, NAN) for row in of_drives], dtype=np.float64)
            for name, of_drives in (rows if score in DETECTION_SCORES else cut).items()
        }
        for score in SCORES
    }


def correlations(drives: Sequence[ScoredDrive], names: Sequence[str]) -> Array:
    """Spearman's correlation of all measures with each other, and with the true error in the last row and
    column: mean over drives, all steps; NaN where one was never measured or constant."""
    matrices = []
    for drive in drives:
        columns = [*(drive.steps.columns[name] for name in names), drive.steps.error]
        ranks = rankdata(columns, axis=1)  # NaN throughout where one value is NaN
        usable = np.ptp(ranks, axis=1) > 0.0
        matrix = np.full((len(ranks), len(ranks)), NAN)
        if usable.any():
            matrix[np.ix_(usable, usable)] = np.corrcoef(ranks[usable])
        matrices.append(matrix)
    return np.ma.masked_invalid(matrices).mean(axis=0).filled(NAN)


@dataclass(frozen=True)
class MeasureSummary:
    """One measure, or a reference that cuts, over all drives: means by score, "log_ate" that of the logarithm
    of ``ate_rmse``, and the decisions of all drives together, None where it has none."""

    name: str
    means: Mapping[str, Mean]
    decision: Decision | None


@dataclass(frozen=True)
class Findings:
    """Summaries and comparisons of the measures over all drives.

    ``values`` of `score_table`; ``lines`` best first; ``by_scenario``: scenario -> measure -> AUC on steps
    with a match; ``ranking`` compares that over all drives, ``mapping`` the logarithm of the position error
    when the measure cuts, each a family of its own.
    """

    drives: tuple[ScoredDrive, ...]
    names: tuple[str, ...]
    values: Mapping[str, Mapping[str, Array]]
    lines: tuple[MeasureSummary, ...]
    by_scenario: Mapping[str, Mapping[str, Mean]]
    ranking: tuple[PairedDifference, ...]
    mapping: tuple[PairedDifference, ...]

    def line(self, name: str) -> MeasureSummary:
        """The line of a measure or a reference."""
        return next(line for line in self.lines if line.name == name)

    def ranked(self) -> list[str]:
        """Measures by their AUC on steps with a match, best first; those without one are left out."""
        return [line.name for line in self.lines if _order(line)[0] == 0]


def analyse(drives: Sequence[ScoredDrive], names: Sequence[str]) -> Findings:
    """Summarise the drives and compare the measures ``names``."""
    rng = np.random.default_rng(SEED)
    values, strata = score_table(drives, names), [drive.scenario for drive in drives]
    logs = {name: np.log(column) for name, column in values["ate_rmse"].items()}
    lines = []
    for name in dict.fromkeys([*names, *logs]):
        columns = {score: by_name[name] for score, by_name in values.items() if name in by_name}
        columns |= {"log_ate": logs[name]} if name in logs else {}
        means = {score: mean_interval(column, strata, rng) for score, column in columns.items()}
        decisions = [] if name in (NEVER, TRUTH) else [decision(drive.steps, name) for drive in drives]
        made = [one for one in decisions if one is not None]
        lines.append(MeasureSummary(name, means, sum(made[1:], made[0]) if made else None))
    scored = {name: values["auc_matched"][name] for name in names if name not in RULES}
    measured = {name: column for name, column in scored.items() if np.isfinite(column).any()}
    by_scenario = {}
    for scenario in dict.fromkeys(strata):
        rows = np.array(strata) == scenario
        by_scenario[scenario] = {
            name: mean_interval(column[rows], [scenario] * int(rows.sum()), rng)
            for name, column in measured.items()
        }
    return Findings(
        tuple(drives),
        tuple(names),
        values,
        tuple(sorted(lines, key=_order)),
        by_scenario,
        tuple(compare_pairs(measured, strata, rng)),
        tuple(compare_pairs(logs, strata, rng)),
    )


def _order(line: MeasureSummary) -> tuple[int, float]:
    """References last, measures without an AUC on matched steps before them."""
    if "auc_matched" not in line.means:
        return 2, 0.0
    auc = line.means["auc_matched"].mean
    return (0, -auc) if np.isfinite(auc) else (1, 0.0)
