"""The outcome of a run in a sentence."""

from __future__ import annotations

from collections.abc import Sequence

from scenarios.evaluation.metric import Metric

HEADLINES = (("ate_rmse", "position error (ATE)"), ("relation_trans_mean", "mean error of the relations"))
BASELINE, CHEAT = "ins", "oracle"


def headline(metrics: Sequence[Metric]) -> tuple[str, str] | None:
    """The metric a run is judged by, with its name in words: ATE, else the relations, else None."""
    measured = {metric.name for metric in metrics if metric.value is not None}
    return next(((name, words) for name, words in HEADLINES if name in measured), None)


def verdict(metrics: Sequence[Metric]) -> str:
    """Which method did best and by how much over dead reckoning; false stitches are told of.

    The oracle, which sees truth, does not compete.
    """
    judged = headline(metrics)
    if judged is None:
        return (
            "Nothing to score against: the recording has neither truth nor relations. Judge the maps by eye."
        )
    name, words = judged
    scores = {
        m.method: m.value for m in metrics if m.name == name and m.value is not None and m.method != CHEAT
    }
    if not scores:
        return f"No method but the {CHEAT} was scored."
    best = min(scores, key=lambda method: scores[method])
    return " ".join([_ranking(best, scores, words), *_false_stitches(metrics)])


def _ranking(best: str, scores: dict[str, float], words: str) -> str:
    others = {method: score for method, score in scores.items() if method != best}
    if not others:
        return f"{best}: {words} {_metres(scores[best])}."
    if best == BASELINE:
        second = min(others, key=lambda method: others[method])
        return (
            f"No method improves on dead reckoning: {words} {_metres(scores[best])}, "
            f"next is {second} with {_metres(others[second])}."
        )
    text = f"{best} is best: {words} {_metres(scores[best])}"
    if BASELINE in scores and scores[best] > 0.0:
        times = scores[BASELINE] / scores[best]
        digits = 1 if times < 10.0 else 0
        return f"{text}, {times:.{digits}f} times better than dead reckoning ({_metres(scores[BASELINE])})."
    return f"{text}."


def _false_stitches(metrics: Sequence[Metric]) -> list[str]:
    return [
        f"{m.method} accepted {m.value:.0f} false stitch{'' if m.value == 1 else 'es'}."
        for m in metrics
        if m.name == "stitches_false" and m.value
    ]


def _metres(value: float) -> str:
    return f"{value:.3f} m" if value < 10.0 else f"{value:.1f} m"
