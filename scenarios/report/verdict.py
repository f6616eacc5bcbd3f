"""The outcome of a run in a sentence."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from scenarios.evaluation.metric import Metric
from scenarios.report.cuts import cuts
from stitch.mapping.estimate import Estimate

HEADLINES = (("ate_rmse", "position error (ATE)"), ("relation_trans_mean", "mean error of the relations"))
BASELINE, CHEAT = "ins", "oracle"
COLOURS = ("slamstitch", "ins", "wsm", "htms", "icp", "oracle")
"""Methods that keep their colour on every page; two more are for others."""


def headline(metrics: Sequence[Metric]) -> tuple[str, str] | None:
    """The metric a run is judged by, with its name in words: ATE, else the relations, else None."""
    measured = {metric.name for metric in metrics if metric.value is not None}
    return next(((name, words) for name, words in HEADLINES if name in measured), None)


@dataclass(frozen=True)
class Score:
    """What a method has in the metric a run is judged by, and what that is beside dead reckoning; ``colour``
    is the number of its colour."""

    colour: int
    method: str
    text: str
    versus: str
    best: bool


def best_method(metrics: Sequence[Metric]) -> str | None:
    """The method with the best score; the oracle, which sees truth, does not compete."""
    scores = {method: score for method, score in _scores(metrics).items() if method != CHEAT}
    return min(scores, key=lambda method: scores[method]) if scores else None


def scores(metrics: Sequence[Metric], methods: Sequence[str]) -> list[Score]:
    """Every method's score, the best first, those without one last; none where nothing is judged."""
    found, best = _scores(metrics), best_method(metrics)
    if not found:
        return []
    base = found.get(BASELINE)

    def rank(named: tuple[str, int]) -> float:
        return found.get(named[0], float("inf"))

    return [
        Score(
            colour,
            method,
            _metres(found[method]) if method in found else "–",
            _beside(method, found.get(method), base),
            method == best and len(found) > 1,
        )
        for method, colour in sorted(zip(methods, colours(methods), strict=True), key=rank)
    ]


def colours(methods: Sequence[str]) -> list[int]:
    """The number of every method's colour: known ones keep theirs on every page."""
    others = [method for method in methods if method not in COLOURS]
    return [
        COLOURS.index(method) if method in COLOURS else len(COLOURS) + others.index(method) % 2
        for method in methods
    ]


def verdict(metrics: Sequence[Metric], estimates: Sequence[Estimate] = ()) -> str:
    """Which method did best and by how much over dead reckoning; its cuts and stitches, and false stitches of
    all.

    The oracle does not compete. Of ``estimates`` the cuts are counted.
    """
    judged, best = headline(metrics), best_method(metrics)
    if judged is None:
        return (
            "Nothing to score against: the recording has neither truth nor relations. Judge the maps by eye."
        )
    if best is None:
        return f"No method but the {CHEAT} was scored."
    scored = {method: score for method, score in _scores(metrics).items() if method != CHEAT}
    cut = next((len(cuts(e.submaps)) for e in estimates if e.method == best and e.submaps), None)
    sentence = _ranking(best, scored, judged[1])
    return " ".join([sentence + _stitching(best, cut, metrics), *_false_stitches(metrics, best)])


def _scores(metrics: Sequence[Metric]) -> dict[str, float]:
    """Method -> its score in the metric a run is judged by."""
    judged = headline(metrics)
    return {m.method: m.value for m in metrics if judged and m.name == judged[0] and m.value is not None}


def _beside(method: str, score: float | None, base: float | None) -> str:
    if score is None:
        return "not scored"
    if method == BASELINE:
        return "dead reckoning"
    if not base or score <= 0.0:
        return ""
    return f"{base / score:.3g} times better" if score <= base else f"{score / base:.3g} times worse"


def _stitching(best: str, cut: int | None, metrics: Sequence[Metric]) -> str:
    """The end of the sentence: what the best method cut and stitched."""
    counts = {m.name: int(m.value) for m in metrics if m.method == best and m.value is not None}
    if "stitches_accepted" not in counts:
        return "."
    told = [] if cut is None else [f"{cut} cut{'' if cut == 1 else 's'}"]
    told.append(f"{counts['stitches_accepted']} of {counts['stitches_tried']} stitches accepted")
    if "stitches_false" in counts:
        told.append(f"{counts['stitches_false']} false")
    return f"; {', '.join(told)}."


def _ranking(best: str, scores: dict[str, float], words: str) -> str:
    others = {method: score for method, score in scores.items() if method != best}
    if not others:
        return f"{best}: {words} {_metres(scores[best])}"
    if best == BASELINE:
        second = min(others, key=lambda method: others[method])
        return (
            f"No method improves on dead reckoning: {words} {_metres(scores[best])}, "
            f"next is {second} with {_metres(others[second])}"
        )
    text = f"{best} is best: {words} {_metres(scores[best])}"
    if BASELINE in scores and scores[best] > 0.0:
        times = scores[BASELINE] / scores[best]
        digits = 1 if times < 10.0 else 0
        return f"{text}, {times:.{digits}f} times better than dead reckoning ({_metres(scores[BASELINE])})"
    return text


def _false_stitches(metrics: Sequence[Metric], told: str) -> list[str]:
    """Sentences about false stitches of the methods but the one ``told`` of already."""
    return [
        f"{m.method} accepted {m.value:.0f} false stitch{'' if m.value == 1 else 'es'}."
        for m in metrics
        if m.name == "stitches_false" and m.value and m.method != told
    ]


def _metres(value: float) -> str:
    return f"{value:.3f} m" if value < 10.0 else f"{value:.1f} m"
