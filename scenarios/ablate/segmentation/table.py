"""The study as a table for the console, as results.csv and as JSON."""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Mapping
from typing import TYPE_CHECKING

from scenarios.ablate.segmentation.scores import DOWNSTREAM, SCORES, scored

if TYPE_CHECKING:
    from collections.abc import Sequence

    from scenarios.ablate.segmentation.findings import Findings, Line
    from scenarios.ablate.segmentation.statistics import Mean

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

ABSENT = "–"


def cells(line: Line) -> list[str]:
    """A line's numbers as printed; precision, recall and F1 are of all steps of all drives together."""
    found = []
    for score, _, decimals in COLUMNS.values():
        if score in ("precision", "recall", "f1"):
            value = getattr(line.decision, score) if line.decision is not None else math.nan
            found.append(_plain(value, decimals))
        elif score not in line.means:
            found.append(ABSENT)
        else:
            found.append(_cell(line.means[score], decimals, score))
    return found


def notes(found: Findings) -> list[str]:
    """What the table is of, and how its numbers came about."""
    drives, seeds = found.drives, [drive.seed for drive in found.drives]
    steps = sum(len(drive.steps.error) for drive in drives)
    lost = sum(int(drive.steps.lost.sum()) for drive in drives)
    matched = sum(int(drive.steps.matched.sum()) for drive in drives)
    lost_matched = sum(int((drive.steps.lost & drive.steps.matched).sum()) for drive in drives)
    return [
        f"{len(drives)} drives ({', '.join(found.scenarios)}; seeds {min(seeds)} to {max(seeds)}). A step is "
        "lost that is off by more than 0.2 m or 5°. Base rates, which AP has where nothing is known: "
        f"{lost / steps:.3f} of {steps} steps, {lost_matched / max(matched, 1):.3f} of {matched} with a "
        "match.",
        "Means over drives [95 % interval: bootstrap over drives, each scenario by itself]; P, R and F1 of "
        "all steps together, at thresholds learnt on other scenarios and seeds.",
        "Comparisons are paired by drive: random signs of the differences, corrected for being many by Holm, "
        "one family for AUC and one for ATE; what is called sure has p < 0.05 after that and an interval "
        "without zero.",
    ]


def print_findings(title: str, found: Findings, verdict: Sequence[str]) -> None:
    """The table, its notes and the verdict on stdout."""
    import rich.box
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    table = Table(title=title, box=rich.box.SIMPLE_HEAD)
    table.add_column("measure", no_wrap=True)
    for heading in COLUMNS:
        table.add_column(heading, justify="right", no_wrap=True)
    for line in found.lines:
        table.add_row(line.name, *(Text(cell) for cell in cells(line)))
    console = Console(width=max(180, Console().width), highlight=False)
    console.print(table)
    for note in [*notes(found), "", *verdict]:
        console.print(Text(note), soft_wrap=True)


def results_csv(found: Findings) -> str:
    """One row per drive and measure or reference, in the drives' order; ``seconds`` come last."""
    text = io.StringIO()
    rows = csv.writer(text, lineterminator="\n")
    counts = ("steps", "lost", "steps_matched", "lost_matched")
    rows.writerow(["scenario", "seed", "measure", *counts, *SCORES, *DOWNSTREAM])
    for drive in found.drives:
        steps = drive.steps
        about = [len(steps.error), steps.lost.sum(), steps.matched.sum(), (steps.lost & steps.matched).sum()]
        for name in dict.fromkeys([*found.names, *drive.cuts]):
            scores: Mapping[str, float] = scored(steps, name) if name in found.names else {}
            numbers = [scores.get(score, math.nan) for score in SCORES]
            numbers += [drive.cuts.get(name, {}).get(number, math.nan) for number in DOWNSTREAM]
            rows.writerow([drive.scenario, drive.seed, name, *about, *map(_number, numbers)])
    return text.getvalue()


def findings_json(found: Findings, about: Mapping[str, object], verdict: Sequence[str]) -> str:
    """The same as one object; a number that does not exist is null."""
    lines = [
        {
            "measure": line.name,
            "decision": None if line.decision is None else vars(line.decision),
            **{score: _mean(one) for score, one in line.means.items()},
        }
        for line in found.lines
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
            for one in comparisons
        ]
        for family, comparisons in (("auc_matched", found.ranking), ("log_ate", found.mapping))
    }
    everything = {"schema": 1, **about, "verdict": verdict, "measures": lines, "comparisons": pairs}
    return json.dumps(everything, indent=2)


def _mean(one: Mean) -> dict[str, float | int | None]:
    numbers = {"mean": one.value, "low": one.low, "high": one.high}
    return {**{key: value if math.isfinite(value) else None for key, value in numbers.items()}, "n": one.n}


def _cell(one: Mean, decimals: int, score: str) -> str:
    value, low, high = one.value, one.low, one.high
    if score == "log_ate":
        value, low, high = math.exp(value), math.exp(low), math.exp(high)
    if score not in INTERVALS or not math.isfinite(low):
        return _plain(value, decimals)
    return f"{value:.{decimals}f} [{low:.{decimals}f}, {high:.{decimals}f}]"


def _plain(value: float, decimals: int) -> str:
    return f"{value:.{decimals}f}" if math.isfinite(value) else ABSENT


def _number(value: float | None) -> str:
    if value is None or math.isnan(value):
        return ""
    return f"{value:.9g}"
