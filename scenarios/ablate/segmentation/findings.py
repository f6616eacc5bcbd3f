"""The results of the study, for the table, the figures and the page."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from scenarios.ablate.segmentation.learning import RULES
from scenarios.ablate.segmentation.scores import ScoredDrive, pooled_decision, score_table
from scenarios.ablate.segmentation.trials import NEVER, TRUTH
from scenarios.ablate.statistics import Mean, PairedDifference, compare_pairs, mean_interval
from scenarios.evaluation.detection import Decision
from slam.se2 import Array

SEED = 0
"""Of the generator that intervals draw from."""


@dataclass(frozen=True)
class MeasureSummary:
    """One measure, or a reference that cuts, over all drives: means by score, and its decisions together."""

    name: str
    means: Mapping[str, Mean]
    decision: Decision | None


@dataclass(frozen=True)
class Findings:
    """Summaries and comparisons of the measures over all drives.

    ``values`` of `scores.score_table`; ``lines`` best first; ``by_scenario``: scenario -> measure ->
    AUC on steps with a match; ``ranking`` compares that over all drives, ``mapping`` the logarithm of the
    position error when the measure cuts, each a family of its own.
    """

    drives: tuple[ScoredDrive, ...]
    names: tuple[str, ...]
    values: Mapping[str, Mapping[str, Array]]
    lines: tuple[MeasureSummary, ...]
    by_scenario: Mapping[str, Mapping[str, Mean]]
    ranking: tuple[PairedDifference, ...]
    mapping: tuple[PairedDifference, ...]

    @property
    def scenarios(self) -> tuple[str, ...]:
        """In the order of the drives."""
        return tuple(dict.fromkeys(drive.scenario for drive in self.drives))

    def line(self, name: str) -> MeasureSummary:
        """The line of a measure or a reference."""
        return next(line for line in self.lines if line.name == name)

    def ranked(self) -> list[str]:
        """Measures by their AUC on steps with a match, best first; those without one are left out."""
        scores = {name: self.line(name).means["auc_matched"].value for name in self.names}
        there = [name for name in self.names if np.isfinite(scores[name])]
        return sorted(there, key=lambda name: -scores[name])


def analyse(drives: Sequence[ScoredDrive], names: Sequence[str]) -> Findings:
    """Summarise the drives and compare the measures ``names``."""
    rng = np.random.default_rng(SEED)
    values, strata = score_table(drives, names), [drive.scenario for drive in drives]
    cutters = list(dict.fromkeys([*names, *values["ate_rmse"]]))
    lines = [_summary(name, drives, values, rng) for name in cutters]
    scored = {name: values["auc_matched"][name] for name in names if name not in RULES}
    measured = {name: column for name, column in scored.items() if np.isfinite(column).any()}
    logs = {name: np.log(column) for name, column in values["ate_rmse"].items()}
    return Findings(
        tuple(drives),
        tuple(names),
        values,
        tuple(sorted(lines, key=_order)),
        _by_scenario(drives, measured, rng),
        tuple(compare_pairs(measured, strata, rng)),
        tuple(compare_pairs(logs, strata, rng)),
    )


def _summary(
    name: str,
    drives: Sequence[ScoredDrive],
    values: Mapping[str, Mapping[str, Array]],
    rng: np.random.Generator,
) -> MeasureSummary:
    columns = {score: by_name[name] for score, by_name in values.items() if name in by_name}
    if "ate_rmse" in columns:
        columns["log_ate"] = np.log(columns["ate_rmse"])
    strata = [drive.scenario for drive in drives]
    means = {score: mean_interval(column, strata, rng) for score, column in columns.items()}
    return MeasureSummary(name, means, None if name in (NEVER, TRUTH) else pooled_decision(drives, name))


def _by_scenario(
    drives: Sequence[ScoredDrive], measured: Mapping[str, Array], rng: np.random.Generator
) -> dict[str, dict[str, Mean]]:
    """Means over the drives of each scenario."""
    strata = np.array([drive.scenario for drive in drives])
    return {
        scenario: {
            name: mean_interval(column[strata == scenario], strata[strata == scenario].tolist(), rng)
            for name, column in measured.items()
        }
        for scenario in dict.fromkeys(strata.tolist())
    }


def _order(line: MeasureSummary) -> tuple[int, float]:
    """References last, measures without an AUC on matched steps before them."""
    if "auc_matched" not in line.means:
        return 2, 0.0
    value = line.means["auc_matched"].value
    return (0, -value) if np.isfinite(value) else (1, 0.0)
