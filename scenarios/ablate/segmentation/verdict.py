"""What the numbers support, in words."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from scenarios.ablate.segmentation.findings import Findings
from scenarios.ablate.segmentation.trials import NEVER, TRUTH
from scenarios.ablate.statistics import PairedDifference

THESIS = ("trace2", "det2", "neg_matches")
"""The measures of Formsma's thesis."""
OURS = "combined"


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
        auc = {name: one.mean for name, one in means.items() if np.isfinite(one.mean)}
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
            f"{pair.first} (×{pair.difference.map(np.exp).text(2)})"
            for pair in sure
            if sign * pair.difference.mean > 0.0
        ]
        if described:
            than = f"surely {words} than uncut by {_listed(described)}"
            sentences.append(f"The final map's position error is {than}.")
    if not sure:
        sentences.append("No measure makes the final map surely better or worse than no cut at all.")
    errors = {name: findings.line(name).means["log_ate"].mean for name in cutters}
    finite = [name for name in cutters if np.isfinite(errors[name])]
    if finite and TRUTH in references:
        best = min(finite, key=errors.__getitem__)
        pair = _between(findings.mapping, TRUTH, best)
        sentences.append(
            f"Of the measures, cutting by {best} leaves the smallest error; cutting just where the truth "
            f"says differs from it by a factor of {np.exp(pair.difference.mean):.2f}, "
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
