"""The study as tables, as rows of results.csv and as JSON, and in words what the numbers support."""

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
from scenarios.ablate.segmentation.trials import NEVER, TRUTH
from scenarios.ablate.statistics import PairedDifference
from scenarios.jsonable import document
from slam.table import ABSENT, Bold, Table, number

PRINTED = {name: score for name, score in SCORES.items() if score.heading}
COUNTS = ("steps", "lost", "steps_matched", "lost_matched")
RESULT_COLUMNS = ("scenario", "seed", "measure", *COUNTS, *SCORES)
THESIS = ("trace2", "det2", "neg_matches")
"""The measures of Formsma's thesis."""
OURS = "combined"


def cells(line: MeasureSummary) -> list[str]:
    """A measure's numbers as printed; precision, recall and F1 are of all steps of all drives together."""
    texts = []
    for name, score in PRINTED.items():
        mean = line.means.get(name)
        if name in DECISION_SCORES:
            texts.append(number(getattr(line.decision, name, None), score.decimals))
        elif mean is None:
            texts.append(ABSENT)
        elif score.interval:
            mean = line.means["log_ate"].map(math.exp) if name == "ate_rmse" else mean
            texts.append(mean.text(score.decimals))
        else:
            texts.append(number(mean.mean, score.decimals))
    return texts


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


def verdict(findings: Findings) -> list[str]:
    """Sentences: which measure, by how much, how sure, where it does not hold, and what the map says."""
    ranked = findings.ranked()
    if not ranked:
        nothing = (
            "No drive has both lost steps and others among those with a match: nothing can be told apart."
        )
        return [nothing, *_maps(findings), _own_front_end(findings)]
    return [
        _best(findings, *ranked),
        *_ours(findings, [name for name in THESIS if name in ranked] if OURS in ranked else []),
        *_where(findings, ranked[0]),
        *_maps(findings),
        _own_front_end(findings),
    ]


def _between(differences: Sequence[PairedDifference], first: str, second: str) -> PairedDifference:
    """The difference of two measures in that order."""
    pair = next(pair for pair in differences if {pair.first, pair.second} == {first, second})
    return pair if pair.first == first else pair.swapped()


def _best(findings: Findings, best: str, *others: str) -> str:
    auc = findings.line(best).means["auc_matched"]
    text = (
        f"{best} finds lost steps best: of the steps with a match, a lost one scores worse than another one "
        f"in {auc.map(lambda share: 100.0 * share).text(1)} % of the cases (AUC, mean of {auc.n} drives)."
    )
    pairs = [_between(findings.ranking, best, name) for name in others]
    alike = [pair.second for pair in pairs if not pair.significant]
    if alike:
        return f"{text} It cannot be told apart from {_listed(alike)} on these drives."
    if not pairs:
        return text
    return f"{text} That is surely more than any other; {others[0]} is next, {_described(pairs[0])}."


def _ours(findings: Findings, against: Sequence[str]) -> list[str]:
    """Whether the combination beats Formsma's measures."""
    if not against:
        return []
    pairs = [_between(findings.ranking, OURS, name) for name in against]
    beaten = all(pair.significant and pair.difference.mean > 0.0 for pair in pairs)
    beats = ", learnt on other scenarios, beats" if beaten else " does not surely beat all of"
    described = _listed([f"{pair.second} ({_described(pair)})" for pair in pairs])
    return [f"Our {OURS} measure{beats} Formsma's: {described}."]


def _where(findings: Findings, best: str) -> list[str]:
    """Scenarios in which the best measure is not the best."""
    if len(findings.by_scenario) < 2:
        return []
    exceptions = []
    for scenario, means in findings.by_scenario.items():
        auc = {name: one.mean for name, one in means.items() if math.isfinite(one.mean)}
        if best not in auc:
            exceptions.append(f"in {scenario} no step with a match was lost, or it was not measured")
            continue
        ahead = sorted((name for name in auc if auc[name] > auc[best]), key=lambda name: -auc[name])[:3]
        if ahead:
            described = _listed([f"{name} ({auc[name]:.3f})" for name in ahead])
            are = "is" if len(ahead) == 1 else "are"
            exceptions.append(f"in {scenario} ({auc[best]:.3f}) {described} {are} ahead of it")
    if not exceptions:
        return [f"{best} has the largest AUC in every one of the {len(findings.by_scenario)} scenarios."]
    return [f"Where that does not hold: {'; '.join(exceptions)}."]


def _maps(findings: Findings) -> list[str]:
    """What cutting by a measure does to the final map."""
    references = [name for name in (NEVER, TRUTH) if name in findings.values["ate_rmse"]]
    cutters = [name for name in findings.values["ate_rmse"] if name not in references]
    if NEVER not in references or not (cutters or TRUTH in references):
        return []
    pairs = [_between(findings.mapping, name, NEVER) for name in cutters]
    sure = sorted((pair for pair in pairs if pair.significant), key=lambda pair: pair.difference.mean)
    sentences = []
    for words, sign in (("smaller", -1.0), ("larger", 1.0)):
        described = [
            f"{pair.first} (×{pair.difference.map(math.exp).text(2)})"
            for pair in sure
            if sign * pair.difference.mean > 0.0
        ]
        if described:
            than = f"surely {words} than uncut by {_listed(described)}"
            sentences.append(f"The final map's position error is {than}.")
    if not sure:
        sentences.append("No measure makes the final map surely better or worse than no cut at all.")
    errors = {name: findings.line(name).means["log_ate"].mean for name in cutters}
    finite = [name for name in cutters if math.isfinite(errors[name])]
    if finite and TRUTH in references:
        best = min(finite, key=errors.__getitem__)
        pair = _between(findings.mapping, TRUTH, best)
        sentences.append(
            f"Of the measures, cutting by {best} leaves the smallest error; cutting just where the truth "
            f"says differs from it by a factor of {math.exp(pair.difference.mean):.2f}, "
            f"{'surely' if pair.significant else 'not surely'}."
        )
    return sentences


def _own_front_end(findings: Findings) -> str:
    drives = findings.drives
    steps, lost = sum(drive.steps_ours for drive in drives), sum(drive.lost_ours for drive in drives)
    there = sum(len(drive.steps.error) for drive in drives)
    lost_there = sum(int(drive.steps.lost.sum()) for drive in drives)
    return (
        f"All this is of ManifoldSLAM, Formsma's front end, lost at {lost_there} of {there} steps "
        f"({lost_there / there:.1%}). slamstitch's own was lost at {lost} of {steps} "
        "on the same drives, which leaves a measure hardly anything to find."
    )


def _described(pair: PairedDifference) -> str:
    return f"{pair.difference.text(3)}, p {pair.p_holm:.2g}"


def _listed(words: Sequence[str]) -> str:
    return words[0] if len(words) == 1 else ", ".join(words[:-1]) + " and " + words[-1]
