"""What the numbers support, in words."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from scenarios.ablate.segmentation.figures import THESIS
from scenarios.ablate.segmentation.findings import Findings
from scenarios.ablate.segmentation.learning import COMBINED
from scenarios.ablate.segmentation.trials import NEVER, TRUTH
from scenarios.ablate.statistics import Mean, PairedDifference


def verdict(findings: Findings) -> list[str]:
    """Sentences: which measure, by how much, how sure, where it does not hold, and what the map says."""
    sentences = [
        _best(findings),
        _ours(findings),
        *_where(findings),
        *_maps(findings),
        _own_front_end(findings),
    ]
    return [sentence for sentence in sentences if sentence]


def between(differences: Sequence[PairedDifference], first: str, second: str) -> PairedDifference | None:
    """The difference of two measures in that order."""
    for one in differences:
        if (one.first, one.second) == (first, second):
            return one
        if (one.first, one.second) == (second, first):
            return one.swapped()
    return None


def _best(findings: Findings) -> str:
    ranked = findings.ranked()
    if not ranked:
        return "No drive has both lost steps and others among those with a match: nothing can be told apart."
    best = findings.line(ranked[0])
    text = (
        f"{best.name} finds lost steps best: of the steps with a match, a lost one scores worse than another "
        f"one in {_percent(best.means['auc_matched'])} of the cases (AUC, mean of "
        f"{best.means['auc_matched'].n} drives)."
    )
    pairs = [(name, between(findings.ranking, best.name, name)) for name in ranked[1:]]
    alike = [name for name, one in pairs if one is None or not one.significant]
    if alike:
        return f"{text} It cannot be told apart from {_listed(alike)} on these drives."
    if len(ranked) == 1:
        return text
    second = between(findings.ranking, best.name, ranked[1])
    assert second is not None
    return f"{text} That is surely more than any other; {ranked[1]} is next, {_describe(second)}."


def _ours(findings: Findings) -> str:
    """Whether the combination beats Formsma's measures."""
    there = [name for name in THESIS if name in findings.ranked()]
    if COMBINED not in findings.ranked() or not there:
        return ""
    described, beaten = [], True
    for name in there:
        one = between(findings.ranking, COMBINED, name)
        assert one is not None
        described.append(f"{name} ({_describe(one)})")
        beaten &= one.significant and one.difference.value > 0.0
    if beaten:
        return f"Our {COMBINED} measure, learnt on other scenarios, beats Formsma's: {_listed(described)}."
    return f"Our {COMBINED} measure does not surely beat all of Formsma's: {_listed(described)}."


def _where(findings: Findings) -> list[str]:
    """Scenarios in which the best measure is not the best, and measures whose rank depends on where."""
    ranked = findings.ranked()
    if not ranked or len(findings.scenarios) < 2:
        return []
    best, sentences = ranked[0], []
    for scenario, means in findings.by_scenario.items():
        there = {name: one.value for name, one in means.items() if np.isfinite(one.value)}
        if best not in there:
            sentences.append(f"in {scenario} no step with a match was lost, or it was not measured")
            continue
        ahead = [name for name, value in there.items() if value > there[best]]
        if ahead:
            described = [f"{name} ({there[name]:.3f})" for name in sorted(ahead, key=lambda n: -there[n])[:3]]
            are = "is" if len(described) == 1 else "are"
            sentences.append(f"in {scenario} ({there[best]:.3f}) {_listed(described)} {are} ahead of it")
    if not sentences:
        return [f"{best} has the largest AUC in every one of the {len(findings.scenarios)} scenarios."]
    return [f"Where that does not hold: {'; '.join(sentences)}."]


def _maps(findings: Findings) -> list[str]:
    """What cutting by a measure does to the final map."""
    cutters = findings.values["ate_rmse"]
    if NEVER not in cutters or len(cutters) < 2:
        return []
    sentences = []
    for sign, words in ((-1, "smaller"), (1, "larger")):
        against = [between(findings.mapping, name, NEVER) for name in cutters if name not in (NEVER, TRUTH)]
        sure = [one for one in against if one is not None and one.significant]
        sure = [one for one in sure if np.sign(one.difference.value) == sign]
        if sure:
            sure.sort(key=lambda one: one.difference.value)
            described = [f"{one.first} ({_ratio(one)})" for one in sure]
            sentences.append(
                f"The final map's position error is surely {words} than uncut by {_listed(described)}."
            )
    if not sentences:
        sentences.append("No measure makes the final map surely better or worse than no cut at all.")
    candidates = {n: findings.line(n).means["log_ate"].value for n in cutters if n not in (NEVER, TRUTH)}
    finite = {name: value for name, value in candidates.items() if np.isfinite(value)}
    if finite and TRUTH in cutters:
        best = min(finite, key=lambda name: finite[name])
        one = between(findings.mapping, best, TRUTH)
        if one is not None:
            how = "surely" if one.significant else "not surely"
            sentences.append(
                f"Of the measures, cutting by {best} leaves the smallest error; cutting just where the truth "
                f"says differs from it by a factor of {np.exp(-one.difference.value):.2f}, {how}."
            )
    return sentences


def _own_front_end(findings: Findings) -> str:
    steps = sum(drive.steps_ours for drive in findings.drives)
    lost = sum(drive.lost_ours for drive in findings.drives)
    there = sum(len(drive.steps.error) for drive in findings.drives)
    lost_there = sum(int(drive.steps.lost.sum()) for drive in findings.drives)
    return (
        f"All this is of ManifoldSLAM, Formsma's front end, lost at {lost_there} of {there} steps "
        f"({lost_there / there:.1%}). slamstitch's own was lost at {lost} of {steps} "
        "on the same drives, which leaves a measure hardly anything to find."
    )


def _describe(one: PairedDifference) -> str:
    d = one.difference
    return f"{d.value:+.3f}{_bounds(d.low, d.high, '+.3f')}, p {_p(one.adjusted)}"


def _ratio(one: PairedDifference) -> str:
    low, value, high = np.exp([one.difference.low, one.difference.value, one.difference.high])
    return f"×{value:.2f}{_bounds(low, high, '.2f')}"


def _percent(mean: Mean) -> str:
    return f"{100.0 * mean.value:.1f} %{_bounds(100.0 * mean.low, 100.0 * mean.high, '.1f')}"


def _bounds(low: float, high: float, form: str) -> str:
    """An interval behind its number; nothing where there is none."""
    return f" [{low:{form}}, {high:{form}}]" if np.isfinite(low) else ""


def _p(value: float) -> str:
    return "< 0.001" if value < 0.001 else f"{value:.3f}"


def _listed(words: Sequence[str]) -> str:
    return words[0] if len(words) == 1 else ", ".join(words[:-1]) + " and " + words[-1]
