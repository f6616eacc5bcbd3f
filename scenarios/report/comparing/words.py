"""A comparison as a table to print: for a terminal, Markdown, LaTeX, or JSON."""

from __future__ import annotations

import io
import json
import re
import sys
from collections.abc import Callable, Sequence

from scenarios.report.comparing.comparison import Cell, Comparison
from scenarios.report.table import ABSENT, ARROWS, UNLIMITED

CHOSEN = ("ate_rmse", "relation_trans_mean", "map_f1", "stitches_false", "wall_s")
"""Metrics of the printed tables; the page has all."""
NOTE = "median / worst over the drives; best median in bold"


def printed(found: Sequence[Comparison], form: str) -> str:
    """The comparisons in one of the forms ``table``, ``markdown``, ``latex`` and ``json`` (which has all)."""
    if form == "json":
        return _json(found)
    some = [comparison for comparison in found if comparison.name in CHOSEN] or list(found)
    write: Callable[[Comparison], str] = {"table": _table, "markdown": _markdown, "latex": _latex}[form]
    return "\n\n".join(write(comparison) for comparison in some)


def cell_text(cell: Cell, bold: Callable[[str], str]) -> str:
    """Median and, over several drives, the worst."""
    if cell.median is None:
        return ABSENT
    text = bold(number(cell.median)) if cell.best else number(cell.median)
    return text if cell.worst is None or len(cell.drives) == 1 else f"{text} / {number(cell.worst[1])}"


def number(value: float) -> str:
    """Three digits that count, whole numbers as they are."""
    return f"{value:.0f}" if value == round(value) or abs(value) >= 1000.0 else f"{value:#.3g}".rstrip(".")


def title(comparison: Comparison) -> str:
    """The metric with its unit and direction."""
    unit = f" [{comparison.definition.unit}]" if comparison.definition.unit else ""
    return f"{comparison.name}{unit} {ARROWS[comparison.definition.better]}".rstrip()


def _table(comparison: Comparison) -> str:
    import rich.box
    import rich.table
    from rich.console import Console
    from rich.text import Text

    table = rich.table.Table(title=Text(f"{title(comparison)}: {NOTE}"), box=rich.box.SIMPLE_HEAD)
    table.add_column("scenario", no_wrap=True)
    for method in comparison.methods:
        table.add_column(Text(method), justify="right", no_wrap=True)
    for scenario, cells in comparison.rows:
        styles = ["bold" if cell.best else "" for cell in cells]
        texts = [cell_text(cell, str) for cell in cells]
        table.add_row(Text(scenario), *(Text(t, style=s) for t, s in zip(texts, styles, strict=True)))
    console = Console(width=UNLIMITED, file=io.StringIO(), record=True)
    console.print(table)
    return console.export_text(styles=sys.stdout.isatty()).rstrip()


def _markdown(comparison: Comparison) -> str:
    def escaped(text: str) -> str:
        return re.sub(r"([|\\`*_<>\[\]])", r"\\\1", text)

    lines = [
        f"{escaped(title(comparison))}: {NOTE}",
        "",
        "| scenario | " + " | ".join(map(escaped, comparison.methods)) + " |",
        "|---|" + "---:|" * len(comparison.methods),
    ]
    for scenario, cells in comparison.rows:
        texts = [cell_text(cell, lambda text: f"**{text}**") for cell in cells]
        lines.append("| " + " | ".join([escaped(scenario), *texts]) + " |")
    return "\n".join(lines)


LATEX = {
    "\\": r"\textbackslash{}", "&": r"\&", "%": r"\%", "$": r"\$", "#": r"\#", "_": r"\_", "{": r"\{",
    "}": r"\}", "~": r"\textasciitilde{}", "^": r"\textasciicircum{}", "↓": r"$\downarrow$",
    "↑": r"$\uparrow$", "°": r"$^\circ$", ABSENT: "--",
}  # fmt: skip


def _latex(comparison: Comparison) -> str:
    """A table for the packages booktabs and graphicx."""

    def escaped(text: str) -> str:
        return "".join(LATEX.get(character, character) for character in text)

    lines = [
        r"\begin{table}",
        rf"\caption{{{escaped(title(comparison))}: {NOTE}}}",
        r"\begin{tabular}{l" + "r" * len(comparison.methods) + "}",
        r"\toprule",
        " & ".join(["scenario", *map(escaped, comparison.methods)]) + r" \\",
        r"\midrule",
    ]
    for scenario, cells in comparison.rows:
        texts = [cell_text(cell, lambda text: rf"\textbf{{{text}}}").replace(ABSENT, "--") for cell in cells]
        lines.append(" & ".join([escaped(scenario), *texts]) + r" \\")
    return "\n".join([*lines, r"\bottomrule", r"\end{tabular}", r"\end{table}"])


def _json(found: Sequence[Comparison]) -> str:
    content = [
        {
            "metric": comparison.name,
            "unit": comparison.definition.unit,
            "better": comparison.definition.better,
            "scenario": scenario,
            "method": method,
            "drives": len(cell.drives),
            "median": cell.median,
            "worst": cell.worst and cell.worst[1],
            "worst_seed": cell.worst and cell.worst[0].seed,
            "values": [value for _, value in cell.drives],
        }
        for comparison in found
        for scenario, cells in comparison.rows
        for method, cell in zip(comparison.methods, cells, strict=True)
        if cell.drives
    ]
    return json.dumps({"schema": 1, "comparisons": content}, indent=1, allow_nan=False)
