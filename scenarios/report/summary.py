"""What a run's metrics say: as a table for the console and the page, as a score for each method, and in a
sentence."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from scenarios.evaluation import KNOWN
from scenarios.evaluation.metric import Metric
from scenarios.evaluation.segmentation import segment_gaps
from scenarios.methods import BASELINE, ONLINE, OURS
from scenarios.report.method_attributes import colour_indices, is_told_the_truth
from slam.mapping.self_consistency import SelfConsistency
from slam.table import ABSENT, Bold, Table, number
from stitch.mapping.estimate import Estimate

ARROWS = {"lower": "↓", "higher": "↑", None: ""}
KINDS = {
    "trajectory": ("coverage", "ate", "yaw", "rpe"),
    "relations": ("relation",),
    "map": ("map", "self"),
    "how sure, and is it true": ("anees", "crps"),
    "cuts and stitches": ("segments", "stitches"),
    "cost": ("wall", "scans", "peak", "latency"),
}
"""Headings, and how the names of the metrics under them begin."""


HEADLINES = (("ate_rmse", "position error (ATE)"), ("relation_trans_mean", "mean error of the relations"))
"""Metrics that a run is judged by, the first that it has, in words."""


@dataclass(frozen=True)
class Cell:
    """A number as printed, whether it is the best of its row, the reason where there is none, and how it
    differs from the baseline's."""

    text: str
    best: bool = False
    reason: str | None = None
    versus: str = ""


@dataclass(frozen=True)
class Row:
    """One metric over all methods."""

    name: str
    unit: str
    arrow: str
    cells: tuple[Cell, ...]
    meaning: str
    cannot_see: str


@dataclass(frozen=True)
class MetricsTable:
    """Rows of metrics, columns of methods; ``absent`` are the metrics that no method has, by the reason."""

    methods: tuple[str, ...]
    rows: tuple[Row, ...]
    absent: tuple[tuple[str, list[str]], ...]

    def kinds(self) -> list[tuple[str, list[Row]]]:
        """The rows under the headings of `KINDS`, what is under none of them last."""
        by_kind: dict[str, list[Row]] = {kind: [] for kind in (*KINDS, "others")}
        for row in self.rows:
            start = row.name.partition("_")[0]
            by_kind[next((kind for kind, starts in KINDS.items() if start in starts), "others")].append(row)
        return [(kind, rows) for kind, rows in by_kind.items() if rows]

    def to_table(self, title: str) -> Table:
        """The table as it is printed; what is best in a row is bold."""
        return Table(
            ["metric", "unit", *(method.replace(" ", "\n") for method in self.methods)],
            [
                [f"{row.name} {row.arrow}".rstrip(), row.unit]
                + [Bold(cell.text) if cell.best else cell.text for cell in row.cells]
                for row in self.rows
            ],
            title,
            names=2,
            notes=[f"no {', '.join(names)}: {reason}" for reason, names in self.absent],
        )


def tabulate(metrics: Sequence[Metric]) -> MetricsTable:
    """The table of ``metrics``: methods in the order they come, metrics in the order of their definitions."""
    methods = tuple(dict.fromkeys(metric.method for metric in metrics))
    by_name: dict[str, dict[str, Metric]] = {}
    for metric in metrics:
        by_name.setdefault(metric.name, {})[metric.method] = metric
    rows: list[Row] = []
    absent: dict[str, list[str]] = {}
    known = [name for name in KNOWN if name in by_name]
    for name in dict.fromkeys([*known, *by_name]):
        by_method = by_name[name]
        if any(metric.value is not None for metric in by_method.values()):
            rows.append(_row(name, by_method, methods))
        else:
            reasons = dict.fromkeys(metric.reason for metric in by_method.values() if metric.reason)
            absent.setdefault("; ".join(reasons), []).append(name)
    return MetricsTable(methods, tuple(rows), tuple(absent.items()))


def _row(name: str, by_method: dict[str, Metric], methods: tuple[str, ...]) -> Row:
    first = next(iter(by_method.values()))
    values = [metric.value for metric in by_method.values() if metric.value is not None]
    best, decimals = _best(values, first.better), _decimals(values)
    comparable = first.better is not None and not name.startswith(KINDS["cost"])  # dead reckoning is free
    baseline = by_method[BASELINE].value if BASELINE in by_method and comparable else None
    cells = []
    for method in methods:
        metric = by_method.get(method)
        if metric is None or metric.value is None:
            cells.append(Cell(ABSENT, reason=metric.reason if metric else "not measured"))
        else:
            versus = "" if method == BASELINE else _difference(metric.value, baseline)
            cells.append(Cell(number(metric.value, decimals), metric.value == best, versus=versus))
    definition = KNOWN.get(name)
    meaning, blind = (definition.meaning, definition.cannot_see) if definition else ("", "")
    return Row(name, first.unit, ARROWS[first.better], tuple(cells), meaning, blind)


def _difference(value: float, baseline: float | None) -> str:
    """By how much a value differs from the baseline's: in per cent, or how many times it is."""
    if baseline is None or baseline <= 0.0 or value < 0.0:
        return ""
    ratio = value / baseline
    return f"×{ratio:.3g}" if ratio >= 10.0 else f"{100.0 * (ratio - 1.0):+.0f} %"


def _best(values: Sequence[float], better: str | None) -> float | None:
    """The value to print in bold: None where neither direction is better or all are alike."""
    if better is None or len(set(values)) < 2:
        return None
    return min(values) if better == "lower" else max(values)


def _decimals(values: Sequence[float]) -> int:
    """Decimals that show three digits of the smallest value of a row, four decimals at most."""
    if all(value == round(value) for value in values):
        return 0
    smallest = min((abs(value) for value in values if value != 0.0), default=1.0)
    return max(0, min(4, 2 - math.floor(math.log10(smallest))))


@dataclass(frozen=True)
class Headline:
    """The metric a run is judged by, its name in ``words``, every method's score [m], less being better, and
    the ``best`` method of those that compete: the oracle, which sees truth, does not."""

    name: str
    words: str
    scores: dict[str, float]
    best: str | None


def headline(metrics: Sequence[Metric]) -> Headline | None:
    """The first of `HEADLINES` that any method has; None without."""
    for name, words in HEADLINES:
        scores = {m.method: m.value for m in metrics if m.name == name and m.value is not None}
        if scores:
            competing = [method for method in scores if not is_told_the_truth(method)]
            return Headline(name, words, scores, min(competing, key=lambda m: scores[m], default=None))
    return None


def scores(judged: Headline | None, methods: Sequence[str]) -> list[dict[str, object]]:
    """Every method's score in words, how it compares with dead reckoning, and the index of its colour; the
    best first, those without one last; none where nothing is judged."""
    if judged is None:
        return []
    values, base = judged.scores, judged.scores.get(BASELINE)
    colours = dict(zip(methods, colour_indices(methods), strict=True))
    return [
        {
            "colour": colours[method],
            "method": method,
            "text": _metres(values[method]) if method in values else ABSENT,
            "versus": "dead reckoning" if method == BASELINE else _times(values.get(method), base),
            "best": method == judged.best and len(values) > 1,
        }
        for method in sorted(methods, key=lambda method: values.get(method, math.inf))
    ]


def _times(score: float | None, base: float | None) -> str:
    """How many times better than the baseline a score is, or worse."""
    if score is None:
        return "not scored"
    if not base or score <= 0.0:
        return ""
    return f"{base / score:.3g} times better" if score <= base else f"{score / base:.3g} times worse"


def verdict(metrics: Sequence[Metric], estimates: Sequence[Estimate] = ()) -> str:
    """That our map is torn where it is; which method did best and by how much over dead reckoning; its cuts
    (those of ``estimates``) and stitches, and false stitches of all."""
    torn = consistency_sentences([e for e in estimates if e.consistency and e.consistency.torn])
    return " ".join([*torn, _scored(metrics, estimates)])


def _scored(metrics: Sequence[Metric], estimates: Sequence[Estimate]) -> str:
    judged = headline(metrics)
    if judged is None:
        return (
            "Nothing to score against: the recording has neither truth nor relations. Judge the maps by eye."
        )
    best = judged.best
    if best is None:
        return "No method but the oracle was scored."
    cuts = next((len(segment_gaps(e.submaps)) for e in estimates if e.method == best and e.submaps), None)
    false = [
        f"{m.method} accepted {m.value:.0f} false stitch{'' if m.value == 1 else 'es'}."
        for m in metrics
        if m.name == "stitches_false" and m.value and m.method != best
    ]
    return " ".join([_ranking(judged, best) + _stitching(best, cuts, metrics), *false])


def consistency_sentences(estimates: Sequence[Estimate]) -> list[str]:
    """Of each of our maps whether it agrees with itself, and where it contradicts itself most."""
    ours = [e for e in estimates if e.method in (OURS, ONLINE) and e.consistency is not None]
    return [_consistency(e.method, e.consistency) for e in ours if e.consistency is not None]


def _consistency(method: str, found: SelfConsistency) -> str:
    if found.figure is None:
        return f"Whether the map of {method} is torn cannot be told: {found.reason}."
    told = "is torn" if found.torn else "agrees with itself"
    text = f"The map of {method} {told} (self_consistency {found.figure:.2f})"
    if not found.places:
        return f"{text}."
    worst, count = found.places[0], len(found.places)
    places = "one place" if count == 1 else f"{count} places"
    return (
        f"{text}; it contradicts itself in {places}, most at ({worst.x:.1f}, {worst.y:.1f}) m, scans "
        f"{worst.scans[0]} and {worst.scans[1]}: {worst.reason}."
    )


def _ranking(judged: Headline, best: str) -> str:
    words, score, base = judged.words, judged.scores[best], judged.scores.get(BASELINE)
    others = {m: s for m, s in judged.scores.items() if m != best and not is_told_the_truth(m)}
    if not others:
        return f"{best}: {words} {_metres(score)}"
    if best == BASELINE:
        second = min(others, key=lambda method: others[method])
        return (
            f"No method improves on dead reckoning: {words} {_metres(score)}, "
            f"next is {second} with {_metres(others[second])}"
        )
    text = f"{best} is best: {words} {_metres(score)}"
    if base is None or score <= 0.0:
        return text
    digits = 1 if base / score < 10.0 else 0
    return f"{text}, {base / score:.{digits}f} times better than dead reckoning ({_metres(base)})"


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


def _metres(value: float) -> str:
    return f"{value:.3f} m" if value < 10.0 else f"{value:.1f} m"
