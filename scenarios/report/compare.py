"""python -m scenarios.report RUN …: runs and sweeps side by side, printed and as a page."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from urllib.parse import quote

from scenarios.report.comparison import (
    ComparisonCell,
    MethodResult,
    MetricComparison,
    collect_results,
    compare_metrics,
)
from scenarios.report.html import environment, own_style, theme_script
from scenarios.report.method_attributes import colour_indices
from scenarios.report.metrics_table import ARROWS
from scenarios.report.strip_plot import strip_plot
from slam.table import ABSENT, Bold, Table

CHOSEN = ("ate_rmse", "relation_trans_mean", "map_f1", "stitches_false", "wall_s")
"""Metrics of the printed tables; the page has all."""
NOTE = "median / worst over the drives; best median in bold"


def run(folders: Sequence[Path], out: Path | None, form: str) -> str:
    """Compare, write the page to ``out`` where one is wanted, and return the tables in a form to print.

    Raises `InputError`.
    """
    results = collect_results(folders)
    comparisons = compare_metrics(results)
    if out is not None:
        page = render(results, comparisons, out.parent)
        out.parent.mkdir(parents=True, exist_ok=True)
        out.write_text(page, encoding="utf-8")
    text = to_text(comparisons, form)
    return text if out is None or form != "table" else f"{text}\n\n{out}"


def to_text(comparisons: Sequence[MetricComparison], form: str) -> str:
    """The comparisons in one of the forms ``table``, ``markdown``, ``latex`` and ``json`` (which has all)."""
    if form == "json":
        return json.dumps({"schema": 1, "comparisons": _entries(comparisons)}, indent=1, allow_nan=False)
    chosen = [comparison for comparison in comparisons if comparison.name in CHOSEN] or comparisons
    tables = [to_table(comparison) for comparison in chosen]
    if form == "table":
        return "\n\n".join(table.console(styled=sys.stdout.isatty()) for table in tables)
    return "\n\n".join(table.markdown() if form == "markdown" else table.latex() for table in tables)


def to_table(comparison: MetricComparison) -> Table:
    """Scenarios in rows, methods in columns: the median and, over several drives, the worst."""
    return Table(
        ["scenario", *comparison.methods],
        [[scenario, *map(_text, cells)] for scenario, cells in comparison.rows],
        f"{_title(comparison)}: {NOTE}",
    )


def _text(cell: ComparisonCell) -> str | Bold:
    if cell.median is None:
        return ABSENT
    worst = "" if cell.worst is None or len(cell.results) == 1 else f" / {number(cell.worst[1])}"
    text = number(cell.median) + worst
    return Bold(text) if cell.best else text


def number(value: float) -> str:
    """Three digits that count, whole numbers as they are."""
    return f"{value:.0f}" if value == round(value) or abs(value) >= 1000.0 else f"{value:#.3g}".rstrip(".")


def _title(comparison: MetricComparison) -> str:
    """The metric with its unit and direction."""
    unit = f" [{comparison.definition.unit}]" if comparison.definition.unit else ""
    return f"{comparison.name}{unit} {ARROWS[comparison.definition.better]}".rstrip()


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
        for scenario, cells in comparison.rows
        for method, cell in zip(comparison.methods, cells, strict=True)
        if cell.results
    ]


def render(results: Sequence[MethodResult], comparisons: Sequence[MetricComparison], folder: Path) -> str:
    """The page of a comparison that is put into ``folder``, from which runs are linked."""
    from markupsafe import Markup

    methods = list(dict.fromkeys(result.method for result in results))
    address = partial(link, folder=folder)
    return environment().get_template("compare.html.j2").render(
        drives=len({(result.scenario, result.seed) for result in results}),
        scenarios=list(dict.fromkeys(result.scenario for result in results)),
        methods=methods,
        colours=colour_indices(methods),
        metrics=[(comparison, strip_plot(comparison, address)) for comparison in comparisons],
        chosen=CHOSEN,
        title=_title,
        number=number,
        link=address,
        note=NOTE,
        style=Markup(own_style()),
        script=Markup(theme_script()),
    )  # fmt: skip


def link(result: MethodResult, folder: Path) -> str | None:
    """The address of a run's page from ``folder``; None where it has none."""
    if result.page is None:
        return None
    return quote(Path(os.path.relpath(result.page, folder.resolve())).as_posix())
