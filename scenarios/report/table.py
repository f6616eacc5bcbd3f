"""One table of metrics, for the console and for the page alike."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from scenarios.evaluation.definitions import DEFINITIONS
from scenarios.evaluation.metric import Metric

if TYPE_CHECKING:
    import rich.table

ARROWS = {"lower": "↓", "higher": "↑", None: ""}
ABSENT = "–"
BASELINE = "ins"
"""The method that the others are compared with: dead reckoning."""
KINDS = {
    "trajectory": ("ate", "yaw", "rpe"),
    "relations": ("relation",),
    "map": ("map",),
    "how sure, and is it true": ("anees",),
    "cuts and stitches": ("segments", "stitches"),
    "cost": ("wall", "scans", "peak", "latency"),
}
"""Headings, and how the names of the metrics under them begin."""
UNLIMITED = 10_000
"""More columns than a table needs: the terminal may break its lines."""


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
class Table:
    """Rows of metrics, columns of methods; ``absent`` are the metrics no method has, by the reason why."""

    methods: tuple[str, ...]
    rows: tuple[Row, ...]
    absent: tuple[tuple[str, tuple[str, ...]], ...]

    def kinds(self) -> list[tuple[str, list[Row]]]:
        """The rows under the headings of `KINDS`, what is under none of them last."""
        found: dict[str, list[Row]] = {kind: [] for kind in (*KINDS, "others")}
        for row in self.rows:
            start = row.name.partition("_")[0]
            found[next((kind for kind, starts in KINDS.items() if start in starts), "others")].append(row)
        return [(kind, rows) for kind, rows in found.items() if rows]


def tabulate(metrics: Sequence[Metric]) -> Table:
    """The table of ``metrics``: methods in the order they come, metrics in the order of their definitions."""
    methods = tuple(dict.fromkeys(metric.method for metric in metrics))
    by_name: dict[str, dict[str, Metric]] = {}
    for metric in metrics:
        by_name.setdefault(metric.name, {})[metric.method] = metric
    order = {name: i for i, name in enumerate(DEFINITIONS)}
    rows: list[Row] = []
    absent: dict[str, list[str]] = {}
    for name in sorted(by_name, key=lambda name: order.get(name, len(order))):
        found = by_name[name]
        if any(metric.value is not None for metric in found.values()):
            rows.append(_row(name, found, methods))
        else:
            absent.setdefault(_reasons(found), []).append(name)
    return Table(methods, tuple(rows), tuple((reason, tuple(names)) for reason, names in absent.items()))


def print_table(table: Table, title: str) -> None:
    """The table on stdout, as wide as it needs to be: a number cut short would be a wrong number."""
    from rich.console import Console

    Console(width=UNLIMITED).print(to_rich(table, title))


def to_rich(table: Table, title: str | None = None) -> rich.table.Table:
    """The table for the console; what is best in a row is bold."""
    import rich.box
    import rich.table
    from rich.text import Text

    caption = "\n".join(f"no {', '.join(names)}: {reason}" for reason, names in table.absent)
    output = rich.table.Table(
        title=Text(title) if title else None,
        caption=Text(caption) if caption else None,
        caption_justify="left",
        box=rich.box.SIMPLE_HEAD,
    )
    output.add_column("metric", no_wrap=True)
    output.add_column("unit", no_wrap=True)
    for method in table.methods:
        output.add_column(Text(method.replace(" ", "\n")), justify="right", vertical="bottom", no_wrap=True)
    for row in table.rows:
        cells = [Text(cell.text, style="bold" if cell.best else "") for cell in row.cells]
        output.add_row(Text(f"{row.name} {row.arrow}".rstrip()), row.unit, *cells)
    return output


def _row(name: str, found: dict[str, Metric], methods: tuple[str, ...]) -> Row:
    values = [metric.value for metric in found.values() if metric.value is not None]
    better = next(iter(found.values())).better
    best = _best(values, better)
    decimals = _decimals(values)
    comparable = better is not None and not name.startswith(KINDS["cost"])  # dead reckoning costs nothing
    baseline = found[BASELINE].value if BASELINE in found and comparable else None
    cells = []
    for method in methods:
        metric = found.get(method)
        if metric is None or metric.value is None:
            cells.append(Cell(ABSENT, reason=metric.reason if metric else "not measured"))
        else:
            versus = "" if method == BASELINE else _difference(metric.value, baseline)
            cells.append(Cell(f"{metric.value:.{decimals}f}", metric.value == best, versus=versus))
    definition = DEFINITIONS.get(name)
    return Row(
        name,
        next(iter(found.values())).unit,
        ARROWS[better],
        tuple(cells),
        definition.meaning if definition else "",
        definition.cannot_see if definition else "",
    )


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


def _reasons(found: dict[str, Metric]) -> str:
    return "; ".join(dict.fromkeys(metric.reason for metric in found.values() if metric.reason))
