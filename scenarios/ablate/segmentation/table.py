"""The study as a table, as results.csv and as JSON."""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Mapping, Sequence

from scenarios.ablate.segmentation.findings import Findings, MeasureSummary
from scenarios.ablate.segmentation.scores import DOWNSTREAM, SCORES, score_measure
from scenarios.ablate.statistics import Mean, PairedDifference
from scenarios.jsonable import jsonable
from slam.table import ABSENT, Bold, Table, number, with_interval

COLUMNS: dict[str, tuple[str, str, int]] = {
    "AUC": ("auc", "all steps", 3),
    "AUC matched": ("auc_matched", "steps with a match", 3),
    "AP": ("ap", "all steps", 3),
    "AP matched": ("ap_matched", "steps with a match", 3),
    "P": ("precision", "at its threshold", 2),
    "R": ("recall", "at its threshold", 2),
    "F1": ("f1", "at its threshold", 2),
    "ρ error": ("spearman_error", "with the true error", 2),
    "pieces": ("pieces", "cut into", 1),
    "pure": ("pure", "share of scans", 2),
    "ATE": ("log_ate", "m, geometric mean", 3),
    "map F1": ("map_f1", "final map", 3),
}
"""Heading -> score, what it is of, decimals."""
INTERVALS = ("auc_matched", "log_ate", "map_f1")
"""Scores whose interval is printed."""


def cells(line: MeasureSummary) -> list[str]:
    """A measure's numbers as printed; precision, recall and F1 are of all steps of all drives together."""
    return [_cell(line, score, decimals) for score, _, decimals in COLUMNS.values()]


def _cell(line: MeasureSummary, score: str, decimals: int) -> str:
    if score in ("precision", "recall", "f1"):
        return number(getattr(line.decision, score, None), decimals)
    if score not in line.means:
        return ABSENT
    mean = line.means[score]
    limits = (mean.value, mean.low, mean.high)
    value, low, high = map(math.exp, limits) if score == "log_ate" else limits
    return with_interval(value, low if score in INTERVALS else math.nan, high, decimals)


def notes(findings: Findings) -> list[str]:
    """What the table is of, and how its numbers came about."""
    drives, seeds = findings.drives, [drive.seed for drive in findings.drives]
    steps = sum(len(drive.steps.error) for drive in drives)
    lost = sum(int(drive.steps.lost.sum()) for drive in drives)
    matched = sum(int(drive.steps.matched.sum()) for drive in drives)
    lost_matched = sum(int((drive.steps.lost & drive.steps.matched).sum()) for drive in drives)
    return [
        f"{len(drives)} drives ({', '.join(findings.scenarios)}; seeds {min(seeds)} to {max(seeds)}). A step "
        "is lost that is off by more than 0.2 m or 5°. Base rates, which AP has where nothing is known: "
        f"{lost / steps:.3f} of {steps} steps, {lost_matched / max(matched, 1):.3f} of {matched} with a "
        "match.",
        "Means over drives [95 % interval: bootstrap over drives, each scenario by itself]; P, R and F1 of "
        "all steps together, at thresholds learnt on other scenarios and seeds.",
        "Comparisons are paired by drive: Wilcoxon's signed-rank test, corrected for being many by Holm, one "
        "family for AUC and one for ATE; what is called sure has p < 0.05 after that and an interval without "
        "zero.",
    ]


def findings_table(title: str, findings: Findings, verdict: Sequence[str]) -> Table:
    """A row per measure and reference; below it the notes and the verdict."""
    rows = [(line.name, *cells(line)) for line in findings.lines]
    return Table(("measure", *COLUMNS), rows, title, notes=[*notes(findings), "", *verdict])


def scenario_table(findings: Findings) -> Table:
    """AUC on steps with a match by measure and scenario, the best of each scenario in bold."""
    by_scenario, ranked = findings.by_scenario, findings.ranked()
    best = {
        scenario: max((mean.value for mean in means.values() if math.isfinite(mean.value)), default=None)
        for scenario, means in by_scenario.items()
    }
    rows = []
    for name in ranked:
        means = {scenario: by_scenario[scenario][name] for scenario in findings.scenarios}
        texts = {s: with_interval(one.value, one.low, one.high, 3) for s, one in means.items()}
        rows.append((name, *(Bold(t) if means[s].value == best[s] else t for s, t in texts.items())))
    return Table(("measure", *findings.scenarios), rows)


def difference_table(larger: str, by: str, differences: Sequence[PairedDifference], ratios: bool) -> Table:
    """Paired differences with their interval and corrected p; ``ratios`` are of differences of logarithms."""
    rows = []
    for one in differences:
        value, low, high = one.difference.value, one.difference.low, one.difference.high
        if ratios:
            value, low, high = math.exp(value), math.exp(low), math.exp(high)
        numbers = with_interval(value, low, high, 2 if ratios else 3)
        rows.append((one.first, one.second, numbers, f"{one.adjusted:.4f}"))
    return Table((larger, "than", by, "p (Holm)"), rows, names=2)


def results_csv(findings: Findings) -> str:
    """One row per drive and measure or reference, in the drives' order; ``seconds`` come last."""
    text = io.StringIO()
    rows = csv.writer(text, lineterminator="\n")
    counts = ("steps", "lost", "steps_matched", "lost_matched")
    rows.writerow(["scenario", "seed", "measure", *counts, *SCORES, *DOWNSTREAM])
    for drive in findings.drives:
        steps = drive.steps
        about = [len(steps.error), steps.lost.sum(), steps.matched.sum(), (steps.lost & steps.matched).sum()]
        for name in dict.fromkeys([*findings.names, *drive.cuts]):
            scores: Mapping[str, float] = score_measure(steps, name) if name in findings.names else {}
            values = [scores.get(score) for score in SCORES]
            values += [drive.cuts.get(name, {}).get(column) for column in DOWNSTREAM]
            texts = ["" if value is None or math.isnan(value) else f"{value:.9g}" for value in values]
            rows.writerow([drive.scenario, drive.seed, name, *about, *texts])
    return text.getvalue()


def findings_json(findings: Findings, about: Mapping[str, object], verdict: Sequence[str]) -> str:
    """The same as one object; a number that does not exist is null."""
    measures = [
        {
            "measure": line.name,
            "decision": line.decision,
            **{score: _mean(mean) for score, mean in line.means.items()},
        }
        for line in findings.lines
    ]
    pairs = {
        family: [
            {
                "first": one.first,
                "second": one.second,
                "difference": _mean(one.difference),
                "p": one.p,
                "p_holm": one.adjusted,
                "significant": one.significant,
            }
            for one in differences
        ]
        for family, differences in (("auc_matched", findings.ranking), ("log_ate", findings.mapping))
    }
    content = {"schema": 1, **about, "verdict": verdict, "measures": measures, "comparisons": pairs}
    return json.dumps(jsonable(content), indent=2)


def _mean(mean: Mean) -> dict[str, float]:
    return {"mean": mean.value, "low": mean.low, "high": mean.high, "n": mean.n}
