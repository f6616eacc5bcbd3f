"""The outcome of a run in a sentence."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from scenarios.evaluation.metric import Metric
from scenarios.methods import BASELINE
from scenarios.report.method_attributes import colour_indices, is_told_the_truth
from scenarios.report.trajectory_figures import segment_gaps
from slam.table import ABSENT
from stitch.mapping.estimate import Estimate

HEADLINES = (("ate_rmse", "position error (ATE)"), ("relation_trans_mean", "mean error of the relations"))


def headline(metrics: Sequence[Metric]) -> tuple[str, str] | None:
    """The metric a run is judged by, with its name in words: ATE, else the relations, else None."""
    measured = {metric.name for metric in metrics if metric.value is not None}
    return next(((name, words) for name, words in HEADLINES if name in measured), None)


@dataclass(frozen=True)
class Score:
    """A method's value of the metric a run is judged by, and how that compares with dead reckoning;
    ``colour`` is the index of its colour."""

    colour: int
    method: str
    text: str
    versus: str
    best: bool


def best_method(metrics: Sequence[Metric]) -> str | None:
    """The method with the best score; the oracle, which sees truth, does not compete."""
    scores = {m: score for m, score in headline_scores(metrics).items() if not is_told_the_truth(m)}
    return min(scores, key=lambda method: scores[method]) if scores else None


def scores(metrics: Sequence[Metric], methods: Sequence[str]) -> list[Score]:
    """Every method's score, the best first, those without one last; none where nothing is judged."""
    values, best = headline_scores(metrics), best_method(metrics)
    if not values:
        return []
    colours = dict(zip(methods, colour_indices(methods), strict=True))
    return [
        Score(
            colours[method],
            method,
            _metres(values[method]) if method in values else ABSENT,
            _versus_baseline(method, values.get(method), values.get(BASELINE)),
            method == best and len(values) > 1,
        )
        for method in sorted(methods, key=lambda method: values.get(method, float("inf")))
    ]


def verdict(metrics: Sequence[Metric], estimates: Sequence[Estimate] = ()) -> str:
    """Which method did best and by how much over dead reckoning; its cuts and stitches, and false stitches of
    all.

    The oracle does not compete. The cuts are counted in ``estimates``.
    """
    judged, best = headline(metrics), best_method(metrics)
    if judged is None:
        return (
            "Nothing to score against: the recording has neither truth nor relations. Judge the maps by eye."
        )
    if best is None:
        return "No method but the oracle was scored."
    scored = {m: score for m, score in headline_scores(metrics).items() if not is_told_the_truth(m)}
    cuts = next((len(segment_gaps(e.submaps)) for e in estimates if e.method == best and e.submaps), None)
    sentence = _ranking(best, scored, judged[1])
    return " ".join([sentence + _stitching(best, cuts, metrics), *_false_stitches(metrics, best)])


def headline_scores(metrics: Sequence[Metric]) -> dict[str, float]:
    """Method -> its score in the metric a run is judged by."""
    judged = headline(metrics)
    return {m.method: m.value for m in metrics if judged and m.name == judged[0] and m.value is not None}


def _versus_baseline(method: str, score: float | None, base: float | None) -> str:
    if score is None:
        return "not scored"
    if method == BASELINE:
        return "dead reckoning"
    if not base or score <= 0.0:
        return ""
    return f"{base / score:.3g} times better" if score <= base else f"{score / base:.3g} times worse"


def _stitching(best: str, cuts: int | None, metrics: Sequence[Metric]) -> str:
    """The end of the sentence: what the best method cut and stitched."""
    counts = {m.name: int(m.value) for m in metrics if m.method == best and m.value is not None}
    if "stitches_accepted" not in counts:
        return "."
    parts = [] if cuts is None else [f"{cuts} cut{'' if cuts == 1 else 's'}"]
    parts.append(f"{counts['stitches_accepted']} of {counts['stitches_tried']} stitches accepted")
    if "stitches_false" in counts:
        parts.append(f"{counts['stitches_false']} false")
    return f"; {', '.join(parts)}."


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


def _false_stitches(metrics: Sequence[Metric], but_of: str) -> list[str]:
    """Sentences about false stitches of all methods but one."""
    return [
        f"{m.method} accepted {m.value:.0f} false stitch{'' if m.value == 1 else 'es'}."
        for m in metrics
        if m.name == "stitches_false" and m.value and m.method != but_of
    ]


def _metres(value: float) -> str:
    return f"{value:.3f} m" if value < 10.0 else f"{value:.1f} m"
