"""A metric over scenarios and methods: all values, their median, and which drive was worst."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from statistics import median

from scenarios.evaluation.definitions import DEFINITIONS, Definition
from scenarios.report.comparing.drives import Drive

EVERYWHERE = "all"
"""The row over all scenarios, where there is more than one."""


@dataclass(frozen=True)
class Cell:
    """The drives of one method in one scenario that have the metric, in the order of their seeds.

    ``best``: no other method has a better median here.
    """

    drives: tuple[tuple[Drive, float], ...]
    worst: tuple[Drive, float] | None
    best: bool

    @property
    def median(self) -> float | None:
        """Median of the values, None without any."""
        return median(value for _, value in self.drives) if self.drives else None


@dataclass(frozen=True)
class Comparison:
    """One metric: rows of scenarios, columns of methods."""

    name: str
    definition: Definition
    methods: tuple[str, ...]
    rows: tuple[tuple[str, tuple[Cell, ...]], ...]

    @property
    def values(self) -> list[float]:
        """All values of all cells."""
        return [value for _, cells in self.rows for cell in cells for _, value in cell.drives]


def comparisons(drives: Sequence[Drive]) -> list[Comparison]:
    """Every metric that any drive has, in the order of their definitions."""
    methods = tuple(dict.fromkeys(drive.method for drive in drives))
    known = {name for drive in drives for name in drive.values}
    return [
        _comparison(name, definition, drives, methods)
        for name, definition in DEFINITIONS.items()
        if name in known
    ]


def _comparison(
    name: str, definition: Definition, drives: Sequence[Drive], methods: tuple[str, ...]
) -> Comparison:
    scenarios = list(dict.fromkeys(drive.scenario for drive in drives))
    rows = [(s, [drive for drive in drives if drive.scenario == s]) for s in scenarios]
    if len(rows) > 1:
        rows.append((EVERYWHERE, list(drives)))
    return Comparison(
        name,
        definition,
        methods,
        tuple((scenario, _row(name, definition, some, methods)) for scenario, some in rows),
    )


def _row(
    name: str, definition: Definition, drives: Sequence[Drive], methods: tuple[str, ...]
) -> tuple[Cell, ...]:
    sign = {"lower": 1.0, "higher": -1.0, None: 0.0}[definition.better]
    cells = []
    for method in methods:
        ordered = sorted((d for d in drives if d.method == method), key=lambda d: (d.scenario, d.seed))
        found = tuple((d, d.values[name]) for d in ordered if name in d.values)
        worst = max(found, key=lambda pair: sign * pair[1]) if found and sign else None
        cells.append(Cell(found, worst, best=False))
    medians = [cell.median for cell in cells if cell.median is not None]
    if not sign or len(set(medians)) < 2:
        return tuple(cells)
    top = min(sign * value for value in medians)
    return tuple(
        Cell(cell.drives, cell.worst, cell.median is not None and sign * cell.median == top) for cell in cells
    )
