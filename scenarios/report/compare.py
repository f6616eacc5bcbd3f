"""python -m scenarios.report RUN …: runs and sweeps side by side, printed and as a page: all values of a
metric over scenarios and methods, their median, and which drive was worst."""

from __future__ import annotations

import csv
import json
import math
import os
import sys
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from statistics import median
from typing import Any
from urllib.parse import quote

from markupsafe import Markup

from scenarios.evaluation import DEFINITIONS
from scenarios.evaluation.metric import Definition
from scenarios.report.html import TEMPLATES, read, template, theme_script
from scenarios.report.method_attributes import colour_indices
from scenarios.report.summary import ARROWS
from scenarios.run_folder.directory import METRICS_FILE
from scenarios.run_folder.read import is_run, read_metrics
from slam.cli import InputError
from slam.table import ABSENT, Bold, Table

CHOSEN = ("ate_rmse", "relation_trans_mean", "map_f1", "stitches_false", "wall_s")
"""Metrics of the printed tables; the page has all."""
NOTE = "median / worst over the drives; best median in bold"
SWEEP_FILE, KEYS = "results.csv", ("scenario", "seed", "method")
"""What a sweep writes: a row per drive and method, whose columns are these and one per metric."""
ALL_SCENARIOS = "all"
"""The row over all scenarios, where there is more than one."""
LEFT, RIGHT, TOP, ROW, GAP, BOTTOM = 104.0, 400.0, 8.0, 13.0, 12.0, 26.0
"""Ends of the axis, height of a row, between two scenarios and under the last, in the picture's units."""
LOG_RATIO = 20.0
"""The axis is logarithmic where the largest error or cost is so many times the smallest."""


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
    """The results of one method in one scenario that have the metric, in the order of their seeds. ``best``:
    no other method has a better median here."""

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
    def title(self) -> str:
        """The metric with its unit and direction."""
        unit = f" [{self.definition.unit}]" if self.definition.unit else ""
        return f"{self.name}{unit} {ARROWS[self.definition.better]}".rstrip()

    def cells(self) -> Iterator[tuple[str, str, ComparisonCell]]:
        """Every cell with its scenario and method, row by row."""
        for scenario, cells in self.rows:
            for method, cell in zip(self.methods, cells, strict=True):
                yield scenario, method, cell


def run(folders: Sequence[Path], out: Path | None, form: str) -> str:
    """Compare, write the page to ``out`` where one is wanted, and return the tables in a form to print.
    Raises `InputError`."""
    results = collect_results(folders)
    comparisons = compare_metrics(results)
    if out is not None:
        page = render(results, comparisons, out.parent)
        out.parent.mkdir(parents=True, exist_ok=True)
        out.write_text(page, encoding="utf-8")
    text = to_text(comparisons, form)
    return text if out is None or form != "table" else f"{text}\n\n{out}"


def collect_results(folders: Sequence[Path]) -> list[MethodResult]:
    """The results in all folders, each once, though a link leads there too. Where a method has two results of
    the same drive, methods are told apart by the folder they are from. Raises `InputError` for a folder that
    is neither a run nor a sweep."""
    results: list[MethodResult] = []
    for folder in dict.fromkeys(map(Path.resolve, folders)):
        if is_run(folder):
            results += _of_run(folder)
        elif (folder / SWEEP_FILE).is_file():
            results += _of_sweep(folder)
        else:
            raise InputError(f"{folder}: expected a run, with {METRICS_FILE}, or a sweep, with {SWEEP_FILE}")
    if not results:
        raise InputError(f"{folders[0]}: holds no drive to compare")
    counts = Counter((result.scenario, result.seed, result.method) for result in results)
    if max(counts.values()) == 1:
        return results
    return [replace(result, method=f"{result.method} ({result.source})") for result in results]


def _of_run(folder: Path) -> Iterator[MethodResult]:
    content, metrics = read_metrics(folder)
    page = folder / "report.html" if (folder / "report.html").is_file() else None
    for method in dict.fromkeys(metric.method for metric in metrics):
        values = {m.name: m.value for m in metrics if m.method == method and m.value is not None}
        spoilt = map(str, content.get("corruptions", ()))
        scenario, seed = " + ".join([str(content["recording"]), *spoilt]), int(content["seed"])
        yield MethodResult(scenario, seed, method, values, page, folder.parent.name)


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


def compare_metrics(results: Sequence[MethodResult]) -> list[MetricComparison]:
    """Every metric that any result has, in the order of their definitions."""
    methods = tuple(dict.fromkeys(result.method for result in results))
    scenarios = dict.fromkeys(result.scenario for result in results)
    groups = [(name, [result for result in results if result.scenario == name]) for name in scenarios]
    if len(groups) > 1:
        groups.append((ALL_SCENARIOS, list(results)))
    comparisons = []
    for name, definition in DEFINITIONS.items():
        if any(name in result.values for result in results):
            rows = tuple((scenario, _cells(name, group, methods)) for scenario, group in groups)
            comparisons.append(MetricComparison(name, definition, methods, rows))
    return comparisons


def _cells(name: str, results: Sequence[MethodResult], methods: Sequence[str]) -> tuple[ComparisonCell, ...]:
    sign = {"lower": 1.0, "higher": -1.0, None: 0.0}[DEFINITIONS[name].better]
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


def to_text(comparisons: Sequence[MetricComparison], form: str) -> str:
    """The comparisons in one of the forms ``table``, ``markdown``, ``latex`` and ``json`` (which has all)."""
    if form == "json":
        return json.dumps({"schema": 1, "comparisons": _entries(comparisons)}, indent=1, allow_nan=False)
    chosen = [comparison for comparison in comparisons if comparison.name in CHOSEN] or comparisons
    tables = [
        Table(
            ["scenario", *comparison.methods],
            [[scenario, *map(_text, cells)] for scenario, cells in comparison.rows],
            f"{comparison.title}: {NOTE}",
        )
        for comparison in chosen
    ]
    if form == "table":
        return "\n\n".join(table.console(styled=sys.stdout.isatty()) for table in tables)
    return "\n\n".join(table.markdown() if form == "markdown" else table.latex() for table in tables)


def _text(cell: ComparisonCell) -> str | Bold:
    """The median and, over several drives, the worst."""
    if cell.median is None:
        return ABSENT
    worst = "" if cell.worst is None or len(cell.results) == 1 else f" / {number(cell.worst[1])}"
    text = number(cell.median) + worst
    return Bold(text) if cell.best else text


def number(value: float) -> str:
    """Three digits that count, whole numbers as they are."""
    return f"{value:.0f}" if value == round(value) or abs(value) >= 1000.0 else f"{value:#.3g}".rstrip(".")


def _entries(comparisons: Sequence[MetricComparison]) -> list[dict[str, object]]:
    return [
        {
            "metric": comparison.name,
            "unit": comparison.definition.unit,
            "better": comparison.definition.better,
            "scenario": scenario,
            "method": method,
            "drives": len(cell.results),
            "median": cell.median,
            "worst": cell.worst and cell.worst[1],
            "worst_seed": cell.worst and cell.worst[0].seed,
            "values": [value for _, value in cell.results],
        }
        for comparison in comparisons
        for scenario, method, cell in comparison.cells()
        if cell.results
    ]


def render(results: Sequence[MethodResult], comparisons: Sequence[MetricComparison], folder: Path) -> str:
    """The page of a comparison that is put into ``folder``, from which runs are linked."""
    methods = list(dict.fromkeys(result.method for result in results))
    address = partial(link, folder=folder)
    return template("compare.html.j2").render(
        drives=len({(result.scenario, result.seed) for result in results}),
        scenarios=list(dict.fromkeys(result.scenario for result in results)),
        methods=methods,
        colours=colour_indices(methods),
        metrics=[(comparison, strip_plot(comparison, address)) for comparison in comparisons],
        chosen=CHOSEN,
        number=number,
        link=address,
        note=NOTE,
        style=Markup(read(TEMPLATES / "page.css")),
        script=Markup(theme_script()),
    )


def link(result: MethodResult, folder: Path) -> str | None:
    """The address of a run's page from ``folder``; None where it has none."""
    if result.page is None:
        return None
    return quote(Path(os.path.relpath(result.page, folder.resolve())).as_posix())


def strip_plot(comparison: MetricComparison, link: Callable[[MethodResult], str | None]) -> dict[str, Any]:
    """All values of a metric as a row of dots for each scenario and method, of which one may be the ``worst``
    with a ``link`` to its page. ``dots`` are objects; ``scenarios`` name, y of the rows; ``ticks`` words, x;
    ``medians`` method, x, y."""
    values = [value for _, _, cell in comparison.cells() for _, value in cell.results]
    low, high = min(values), max(values)
    logarithmic = comparison.definition.better != "higher" and low > 0.0 and high > LOG_RATIO * low
    ticks = _decades(low, high) if logarithmic else _steps(min(low, 0.0), high)

    def place(value: float) -> float:
        a, b, v = (math.log10(x) if logarithmic else x for x in (ticks[0], ticks[-1], value))
        return round(LEFT + (RIGHT - LEFT) * (v - a) / (b - a), 1)

    dots, medians, scenarios, y = [], [], [], TOP
    for scenario, cells in comparison.rows:
        if scenario == ALL_SCENARIOS and len(comparison.rows) > 1:
            continue
        scenarios.append((scenario, y + ROW * len(cells) / 2))
        for k, cell in enumerate(cells):
            y += ROW
            for result, value in cell.results:
                worst = cell.worst is not None and cell.worst[0] is result
                at = {"x": place(value), "y": y - ROW / 2, "method": k}
                dots.append({**at, "result": result, "value": value, "worst": worst, "link": link(result)})
            if cell.median is not None:
                medians.append((k, place(cell.median), y - ROW / 2))
        y += GAP
    return {
        "dots": dots,
        "scenarios": scenarios,
        "ticks": [(f"{tick:g}", place(tick)) for tick in ticks],
        "medians": medians,
        "height": y + BOTTOM,
        "logarithmic": logarithmic,
    }


def _decades(low: float, high: float) -> list[float]:
    return [10.0**k for k in range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)]


def _steps(low: float, high: float) -> list[float]:
    """About five round numbers from below ``low`` to above ``high``."""
    width = max(high - low, 1e-9) / 4.0
    power = 10.0 ** math.floor(math.log10(width))
    step = next(power * factor for factor in (1.0, 2.0, 5.0, 10.0) if power * factor >= width)
    first, last = math.floor(low / step), math.ceil(high / step)
    return [round(step * k, 12) for k in range(first, max(last, first + 1) + 1)]
