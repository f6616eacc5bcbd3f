"""The study's numbers brought together, for the table, the figures and the page alike."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from scenarios.ablate.segmentation.cutting import NEVER, TRUTH
from scenarios.ablate.segmentation.learning import RULES
from scenarios.ablate.segmentation.scores import Drive, pooled, table
from scenarios.ablate.segmentation.statistics import Comparison, Mean, comparisons, mean, resamples
from scenarios.evaluation.detection import Decision
from slam.se2 import Array

SEED = 0
"""Of what intervals and tests draw."""


@dataclass(frozen=True)
class Line:
    """One measure, or a reference that cuts, over all drives: means by score, and its decisions together."""

    name: str
    means: Mapping[str, Mean]
    decision: Decision | None


@dataclass(frozen=True)
class Findings:
    """Everything that is said of the drives.

    ``values`` as `scores.table` makes them; ``lines`` best first; ``by_scenario``: scenario -> measure ->
    AUC on steps with a match; ``ranking`` compares that over all drives, ``mapping`` the logarithm of the
    position error when the measure cuts, each a family of its own. ``mapping_by_scenario`` holds the ratios.
    """

    drives: tuple[Drive, ...]
    names: tuple[str, ...]
    values: Mapping[str, Mapping[str, Array]]
    lines: tuple[Line, ...]
    by_scenario: Mapping[str, Mapping[str, Mean]]
    ranking: tuple[Comparison, ...]
    mapping: tuple[Comparison, ...]

    @property
    def scenarios(self) -> tuple[str, ...]:
        """In the order of the drives."""
        return tuple(dict.fromkeys(drive.scenario for drive in self.drives))

    def line(self, name: str) -> Line:
        """The line of a measure or a reference."""
        return next(line for line in self.lines if line.name == name)

    def ranked(self) -> list[str]:
        """Measures by their AUC on steps with a match, best first; those without one are left out."""
        scores = {name: self.line(name).means["auc_matched"].value for name in self.names}
        there = [name for name in self.names if np.isfinite(scores[name])]
        return sorted(there, key=lambda name: -scores[name])


def findings(drives: Sequence[Drive], names: Sequence[str]) -> Findings:
    """Bring the drives together. ``names`` are the measures that were asked for."""
    rng = np.random.default_rng(SEED)
    values = table(drives, names)
    drawn = resamples([drive.scenario for drive in drives], rng)
    cutters = list(dict.fromkeys([*names, *values["ate_rmse"]]))
    lines = [_line(name, drives, values, drawn) for name in cutters]
    scored = {name: values["auc_matched"][name] for name in names if name not in RULES}
    measured = {name: column for name, column in scored.items() if np.isfinite(column).any()}
    logs = {name: np.log(column) for name, column in values["ate_rmse"].items()}
    return Findings(
        tuple(drives),
        tuple(names),
        values,
        tuple(sorted(lines, key=_order)),
        _by_scenario(drives, measured),
        tuple(comparisons(measured, drawn, rng)),
        tuple(comparisons(logs, drawn, rng)),
    )


def _line(
    name: str, drives: Sequence[Drive], values: Mapping[str, Mapping[str, Array]], drawn: np.ndarray
) -> Line:
    means = {score: mean(columns[name], drawn) for score, columns in values.items() if name in columns}
    if name in values["ate_rmse"]:
        means["log_ate"] = mean(np.log(values["ate_rmse"][name]), drawn)
    return Line(name, means, None if name in (NEVER, TRUTH) else pooled(drives, name))


def _by_scenario(drives: Sequence[Drive], measured: Mapping[str, Array]) -> dict[str, dict[str, Mean]]:
    """Intervals of one scenario's drives, each drawn anew."""
    found = {}
    for scenario in dict.fromkeys(drive.scenario for drive in drives):
        rows = np.array([drive.scenario == scenario for drive in drives])
        drawn = resamples([scenario] * int(rows.sum()), np.random.default_rng(SEED))
        found[scenario] = {name: mean(column[rows], drawn) for name, column in measured.items()}
    return found


def _order(line: Line) -> tuple[int, float]:
    """References last, measures without an AUC on matched steps before them."""
    if "auc_matched" not in line.means:
        return 2, 0.0
    value = line.means["auc_matched"].value
    return (0, -value) if np.isfinite(value) else (1, 0.0)
