"""The study as tables, as a figure, and all of it as one HTML file that opens without a network."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from scenarios.ablate.robustness.findings import Findings, RatioSummary
from scenarios.evaluation import DEFINITIONS
from scenarios.report.html import TEMPLATES, read, template
from scenarios.report.live import data_address
from scenarios.report.style import FONT, WIDTH, png
from sim.corruption import CORRUPTIONS, LEVELS
from slam.colours import BLACK, BLUE, GREY, SKY, VERMILLION
from slam.table import ABSENT, Columns, Table, number, with_interval

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

NOTES = (
    "× clean: error over that of the same method on the same drive unspoilt (ate_rmse where there is truth, "
    "else relation_trans_mean), median over drives [95 % interval, bootstrap over drives]",
    "worst: of all drives, which one in brackets; no answer: drives on which the method refuses or breaks",
)
COLOURS = {"": BLACK, **dict(zip(LEVELS, (SKY, BLUE, VERMILLION), strict=True))}
"""Of the levels; black for what is there or not."""
ABOUT = (
    "scenario",
    "seed",
    "method",
    "drive",
    "corruption",
    "level",
    "seconds",
    "refused",
    "unfit",
    "failure",
)
CLEAN_COLUMNS: Columns = (
    ("recording", lambda one: one.scenario),
    ("method", lambda one: one.method),
    ("drives", lambda one: str(one.drives)),
    ("error [m]", lambda one: number(one.median)),
    ("worst", lambda one: number(one.worst)),
    ("no answer", lambda one: str(one.refused + one.failed)),
)


def ratio_table(findings: Findings, title: str = "") -> Table:
    """A row per corruption, the worst for the judged method first; two columns per method."""
    columns = ["corruption", "level"]
    for method in findings.methods:
        columns += [f"{method} × clean", "worst", "no answer"]
    rows = []
    for row in findings.rows:
        cells, by_method = [row[0].corruption, row[0].level], {one.method: one for one in row}
        for method in findings.methods:
            cells += _cells(by_method.get(method))
        rows.append(cells)
    return Table(columns, rows, title, names=2, notes=NOTES)


def _cells(one: RatioSummary | None) -> list[str]:
    if one is None:
        return [ABSENT] * 3
    worst = f"{number(one.worst, 2)} ({one.worst_drive})" if one.worst_drive else ABSENT
    return [with_interval(one.median, *one.interval), worst, str(one.refused + one.failed)]


def clean_table(findings: Findings) -> Table:
    """A row per recording and method: the errors that ratios are to."""
    return Table.of(findings.clean, CLEAN_COLUMNS, names=2).grouped()


def result_columns(findings: Findings) -> list[str]:
    """Columns of results.csv."""
    known = {name for result in findings.results for name in result.values}
    return [*ABOUT, *(name for name in DEFINITIONS if name in known)]


def result_rows(findings: Findings) -> Iterator[dict[str, object]]:
    """One row per drive, corruption and method. The corruption is part of the scenario's name, so that
    `python -m scenarios.report` tells them apart."""
    for r in findings.results:
        about = {name: getattr(r, name) for name in ABOUT}
        about["scenario"] = f"{r.scenario} + {r.corruption}" if r.corruption else r.scenario
        yield about | dict(r.values)


def draw(findings: Findings) -> Figure:
    """Ratios by corruption and level with their intervals, a panel per method; the worst kind on top."""
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D

    kinds = list(dict.fromkeys(row[0].corruption.partition("=")[0] for row in findings.rows))
    figure = Figure(figsize=(WIDTH, 0.3 * len(kinds) + 1.4), layout="constrained")
    axes = figure.subplots(1, len(findings.methods), sharey=True, squeeze=False)[0]
    for ax, method in zip(axes, findings.methods, strict=True):
        _draw_method(ax, method, findings.of(method), kinds)
    axes[0].set_yticks(range(len(kinds)), kinds, fontsize=FONT["tick"])
    axes[0].set_ylim(len(kinds) - 0.4, -0.6)
    levels = [level for level in COLOURS if any(row[0].level == level for row in findings.rows)]
    words = {"": "there or not"}
    handles = [
        Line2D([], [], color=COLOURS[level], marker="o", linestyle="none", label=words.get(level, level))
        for level in levels
    ]
    figure.legend(
        handles=handles, loc="outside lower center", ncols=max(1, len(handles)), frameon=False, fontsize=9
    )
    return figure


def _draw_method(ax: Axes, method: str, rows: Sequence[RatioSummary], kinds: Sequence[str]) -> None:
    from matplotlib.ticker import LogFormatter

    ax.axvline(1.0, color=GREY, linewidth=1.0)
    for one in rows:
        if not np.isfinite(one.median):
            continue
        place = float(kinds.index(one.corruption.partition("=")[0]))
        place += 0.22 * (list(COLOURS).index(one.level) - 2) if one.level else 0.0
        if np.isfinite(one.interval[0]):
            ax.plot(one.interval, [place, place], color=COLOURS[one.level], linewidth=1.2, alpha=0.6)
        ax.plot(one.median, place, "o", color=COLOURS[one.level], ms=4)
    ax.set_xscale("log")
    ax.xaxis.set_major_formatter("{x:g}")
    ax.xaxis.set_minor_formatter(LogFormatter())  # which leaves out what would not fit
    ax.set_title(method, fontsize=FONT["title"], parse_math=False)
    ax.set_xlabel("error × clean", fontsize=FONT["label"])
    ax.tick_params(labelsize=FONT["tick"], which="both")
    ax.grid(axis="both", color=GREY, linewidth=0.4, alpha=0.6)


def render(findings: Findings, verdict: Sequence[str], picture: bytes, **about: object) -> str:
    """The page, ``about`` the ``command`` that made it."""
    named = dict.fromkeys(row[0].corruption.partition("=")[0] for row in findings.rows)
    return template("page.html.j2", Path(__file__).parent).render(
        style=read(TEMPLATES / "page.css"),
        findings=findings,
        verdict=verdict,
        picture=data_address(picture),
        ratios=ratio_table(findings),
        clean=clean_table(findings),
        kinds=[CORRUPTIONS[name] for name in named],
        drives=len({(r.scenario, r.seed) for r in findings.results}),
        **about,
    )


def save_picture(findings: Findings, path: Path) -> bytes:
    """Write the figure, and return it."""
    content = png(draw(findings))
    path.write_bytes(content)
    return content
