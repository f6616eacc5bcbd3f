"""The study as tables, as rows of results.csv and as JSON."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence

from scenarios.ablate.segmentation.findings import (
    DECISION_SCORES,
    SCORES,
    Findings,
    MeasureSummary,
    score_measure,
)
from scenarios.ablate.statistics import PairedDifference
from scenarios.jsonable import document
from slam.table import ABSENT, Bold, Table, number

PRINTED = {name: score for name, score in SCORES.items() if score.heading}
COUNTS = ("steps", "lost", "steps_matched", "lost_matched")
RESULT_COLUMNS = ("scenario", "seed", "measure", *COUNTS, *SCORES)


def cells(line: MeasureSummary) -> list[str]:
    """A measure's numbers as printed; precision, recall and F1 are of all steps of all drives together."""
    return [_cell(line, name) for name in PRINTED]


def _cell(line: MeasureSummary, name: str) -> str:
    score = SCORES[name]
    if name in DECISION_SCORES:
        return number(getattr(line.decision, name, None), score.decimals)
    if name not in line.means:
        return ABSENT
    mean = line.means["log_ate"].map(math.exp) if name == "ate_rmse" else line.means[name]
    return mean.text(score.decimals) if score.interval else number(mean.mean, score.decimals)


def notes(findings: Findings) -> list[str]:
    """What the table is of, and how its numbers came about."""
    drives, seeds = findings.drives, [drive.seed for drive in findings.drives]
    steps = sum(len(drive.steps.error) for drive in drives)
    lost = sum(int(drive.steps.lost.sum()) for drive in drives)
    matched = sum(int(drive.steps.matched.sum()) for drive in drives)
    lost_matched = sum(int((drive.steps.lost & drive.steps.matched).sum()) for drive in drives)
    scenarios = ", ".join(dict.fromkeys(drive.scenario for drive in drives))
    return [
        f"{len(drives)} drives ({scenarios}; seeds {min(seeds)} to {max(seeds)}). A step is lost that is off "
        "by more than 0.2 m or 5°. Base rates, which AP has where nothing is known: "
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
    headings = [score.heading for score in PRINTED.values()]
    rows = [(line.name, *cells(line)) for line in findings.lines]
    return Table(("measure", *headings), rows, title, notes=[*notes(findings), "", *verdict])


def scenario_table(findings: Findings) -> Table:
    """AUC on steps with a match by measure and scenario, the best of each scenario in bold."""
    ranked, columns = findings.ranked(), []
    for means in findings.by_scenario.values():
        best = max((mean.mean for mean in means.values() if math.isfinite(mean.mean)), default=None)
        texts = [(means[name].mean, means[name].text(3)) for name in ranked]
        columns.append([Bold(text) if value == best else text for value, text in texts])
    return Table(("measure", *findings.by_scenario), list(zip(ranked, *columns, strict=True)))


def difference_table(larger: str, by: str, differences: Sequence[PairedDifference], ratios: bool) -> Table:
    """Significant differences, the largest first; ``ratios`` are of differences of logarithms."""
    sure = [
        pair if pair.difference.mean > 0.0 else pair.swapped() for pair in differences if pair.significant
    ]
    rows = []
    for pair in sorted(sure, key=lambda pair: -pair.difference.mean):
        text = pair.difference.map(math.exp).text(2) if ratios else pair.difference.text(3)
        rows.append((pair.first, pair.second, text, f"{pair.p_holm:.4f}"))
    return Table((larger, "than", by, "p (Holm)"), rows, names=2)


def result_rows(findings: Findings) -> Iterator[dict[str, object]]:
    """One row of `RESULT_COLUMNS` per drive and measure or reference, in the drives' order."""
    for drive in findings.drives:
        lost, matched = drive.steps.lost, drive.steps.matched
        counts = (len(lost), lost.sum(), matched.sum(), (lost & matched).sum())
        for name in dict.fromkeys([*findings.names, *drive.cuts]):
            scores: Mapping[str, float] = score_measure(drive.steps, name) if name in findings.names else {}
            numbers = {**scores, **drive.cuts.get(name, {})}
            texts = {key: f"{value:.9g}" for key, value in numbers.items() if not math.isnan(value)}
            about = {"scenario": drive.scenario, "seed": drive.seed, "measure": name}
            yield about | dict(zip(COUNTS, counts, strict=True)) | texts


def findings_json(findings: Findings, about: Mapping[str, object], verdict: Sequence[str]) -> str:
    """The same as one object; a number that does not exist is null."""
    measures = [{"measure": line.name, "decision": line.decision, **line.means} for line in findings.lines]
    families = {"auc_matched": findings.ranking, "log_ate": findings.mapping}
    pairs = {
        family: [vars(pair) | {"significant": pair.significant} for pair in differences]
        for family, differences in families.items()
    }
    return document(**about, verdict=verdict, measures=measures, comparisons=pairs)
