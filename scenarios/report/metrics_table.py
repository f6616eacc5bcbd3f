"""The metrics of a run as a table: rows of metrics, columns of methods, for the console and for the page."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from scenarios.evaluation import DEFINITIONS
from scenarios.evaluation.metric import Metric
from scenarios.report.method_attributes import BASELINE
from slam.table import ABSENT, Bold, Table, number

ARROWS = {"lower": "↓", "higher": "↑", None: ""}
KINDS = {
    "trajectory": ("ate", "yaw", "rpe"),
    "relations": ("relation",),
    "map": ("map",),
    "how sure, and is it true": ("anees",),
    "cuts and stitches": ("segments", "stitches"),
    "cost": ("wall", "scans", "peak", "latency"),
}
"""Headings, and how the names of the metrics under them begin."""


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
    absent: tuple[tuple[str, tuple[str, ...]], ...]

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
    order = {name: i for i, name in enumerate(DEFINITIONS)}
    rows: list[Row] = []
    absent: dict[str, list[str]] = {}
    for name in sorted(by_name, key=lambda name: order.get(name, len(order))):
        by_method = by_name[name]
        if any(metric.value is not None for metric in by_method.values()):
            rows.append(_row(name, by_method, methods))
        else:
            reasons = dict.fromkeys(metric.reason for metric in by_method.values() if metric.reason)
            absent.setdefault("; ".join(reasons), []).append(name)
    return MetricsTable(
        methods, tuple(rows), tuple((reason, tuple(names)) for reason, names in absent.items())
    )


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
    definition = DEFINITIONS.get(name)
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
