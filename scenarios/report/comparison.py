"""Metrics of many runs and sweeps side by side: all values of a metric over scenarios and methods, their
median, and which drive was worst."""

from __future__ import annotations

import csv
import math
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import median

from scenarios.evaluation import DEFINITIONS
from scenarios.evaluation.metric import Definition
from scenarios.run_folder.directory import METRICS_FILE
from scenarios.run_folder.read import is_run, read_metrics
from slam.cli import InputError

SWEEP_FILE = "results.csv"
"""What a sweep writes: a row per drive and method, a column per metric."""
KEYS = ("scenario", "seed", "method")
ALL_SCENARIOS = "all"
"""The row over all scenarios, where there is more than one."""


@dataclass(frozen=True)
class MethodResult:
    """One method on one drive: its metrics by name, the run's ``page`` where there is one, and the folder
    they are from."""

    scenario: str
    seed: int
    method: str
    values: dict[str, float]
    page: Path | None
    source: str


@dataclass(frozen=True)
class ComparisonCell:
    """The results of one method in one scenario that have the metric, in the order of their seeds.

    ``best``: no other method has a better median here.
    """

    results: tuple[tuple[MethodResult, float], ...]
    worst: tuple[MethodResult, float] | None
    best: bool

    @property
    def median(self) -> float | None:
        """Median of the values, None without any."""
        return median(value for _, value in self.results) if self.results else None


@dataclass(frozen=True)
class MetricComparison:
    """One metric: rows of scenarios, columns of methods."""

    name: str
    definition: Definition
    methods: tuple[str, ...]
    rows: tuple[tuple[str, tuple[ComparisonCell, ...]], ...]

    @property
    def values(self) -> list[float]:
        """All values of all cells."""
        return [value for _, cells in self.rows for cell in cells for _, value in cell.results]

    @property
    def best_methods(self) -> list[tuple[str, str]]:
        """Scenarios, each with a method that has the best median there."""
        return [
            (scenario, method)
            for scenario, cells in self.rows
            for method, cell in zip(self.methods, cells, strict=True)
            if cell.best
        ]


def collect_results(folders: Sequence[Path]) -> list[MethodResult]:
    """The results in all folders, each once, though a link leads there too.

    Where a method has two results of the same drive, methods are told apart by the folder they are from.
    Raises `InputError` for a folder that is neither a run nor a sweep.
    """
    results = [result for folder in dict.fromkeys(map(Path.resolve, folders)) for result in _results(folder)]
    if not results:
        raise InputError(f"{folders[0]}: holds no drive to compare")
    counts = Counter((result.scenario, result.seed, result.method) for result in results)
    if max(counts.values()) == 1:
        return results
    return [replace(result, method=f"{result.method} ({result.source})") for result in results]


def compare_metrics(results: Sequence[MethodResult]) -> list[MetricComparison]:
    """Every metric that any result has, in the order of their definitions."""
    methods = tuple(dict.fromkeys(result.method for result in results))
    scenarios = list(dict.fromkeys(result.scenario for result in results))
    groups = [(name, [result for result in results if result.scenario == name]) for name in scenarios]
    if len(groups) > 1:
        groups.append((ALL_SCENARIOS, list(results)))
    measured = {name for result in results for name in result.values}
    return [
        MetricComparison(
            name,
            definition,
            methods,
            tuple((scenario, _cells(name, definition, group, methods)) for scenario, group in groups),
        )
        for name, definition in DEFINITIONS.items()
        if name in measured
    ]


def _cells(
    name: str, definition: Definition, results: Sequence[MethodResult], methods: tuple[str, ...]
) -> tuple[ComparisonCell, ...]:
    sign = {"lower": 1.0, "higher": -1.0, None: 0.0}[definition.better]
    cells = []
    for method in methods:
        ordered = sorted((r for r in results if r.method == method), key=lambda r: (r.scenario, r.seed))
        measured = tuple((r, r.values[name]) for r in ordered if name in r.values)
        worst = max(measured, key=lambda pair: sign * pair[1]) if measured and sign else None
        cells.append(ComparisonCell(measured, worst, best=False))
    medians = [sign * cell.median for cell in cells if cell.median is not None]
    if not sign or len(set(medians)) < 2:
        return tuple(cells)
    top = min(medians)
    return tuple(replace(c, best=c.median is not None and sign * c.median == top) for c in cells)


def _results(folder: Path) -> Iterator[MethodResult]:
    if is_run(folder):
        yield from _of_run(folder)
    elif (folder / SWEEP_FILE).is_file():
        yield from _of_sweep(folder)
    else:
        raise InputError(f"{folder}: expected a run, with {METRICS_FILE}, or a sweep, with {SWEEP_FILE}")


def _of_run(folder: Path) -> Iterator[MethodResult]:
    content, metrics = read_metrics(folder)
    page = folder / "report.html" if (folder / "report.html").is_file() else None
    scenario, seed, source = str(content["recording"]), int(content["seed"]), folder.parent.name
    for method in dict.fromkeys(metric.method for metric in metrics):
        values = {m.name: m.value for m in metrics if m.method == method and m.value is not None}
        yield MethodResult(scenario, seed, method, values, page, source)


def _of_sweep(folder: Path) -> Iterator[MethodResult]:
    path = folder / SWEEP_FILE
    with path.open(newline="", encoding="utf-8") as file:
        table = csv.DictReader(file)
        absent = [key for key in KEYS if key not in (table.fieldnames or ())]
        if absent:
            raise InputError(f"{path}: expected a column {absent[0]!r}")
        for row in table:
            try:
                values = {name: float(row[name]) for name in DEFINITIONS if row.get(name)}
                seed = int(row["seed"])
            except ValueError as error:
                raise InputError(f"{path}:{table.line_num}: {error}") from error
            finite = {name: value for name, value in values.items() if math.isfinite(value)}
            yield MethodResult(row["scenario"], seed, row["method"], finite, None, folder.name)
