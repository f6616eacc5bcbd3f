"""python -m scenarios.report RUN …: runs and sweeps side by side, printed and as a page."""

from __future__ import annotations

import os
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any
from urllib.parse import quote

from scenarios.report.comparing.comparison import Cell, Comparison, comparisons
from scenarios.report.comparing.drives import Drive, gathered
from scenarios.report.comparing.strip import sentences, strip
from scenarios.report.comparing.words import CHOSEN, NOTE, number, printed, title


def run(folders: Sequence[Path], out: Path | None, form: str) -> str:
    """Compare, write the page to ``out`` where one is wanted, and return the tables in a form to print."""
    drives = gathered(folders)
    found = comparisons(drives)
    if out is not None:
        page = render(drives, found, out.parent)
        out.parent.mkdir(parents=True, exist_ok=True)
        out.write_text(page, encoding="utf-8")
    words = printed(found, form)
    return words if out is None or form != "table" else f"{words}\n\n{out}"


def render(drives: Sequence[Drive], found: Sequence[Comparison], where: Path) -> str:
    """The page of a comparison that is put into the folder ``where``, from which runs are linked."""
    from markupsafe import Markup

    from scenarios.report.assets import own_style, theme_script
    from scenarios.report.page import environment
    from scenarios.report.verdict import colours

    methods = list(dict.fromkeys(drive.method for drive in drives))
    return environment().get_template("compare.html.j2").render(
        drives=len({(drive.scenario, drive.seed) for drive in drives}),
        scenarios=list(dict.fromkeys(drive.scenario for drive in drives)),
        methods=methods,
        colours=colours(methods),
        metrics=[_shown(comparison, where) for comparison in found],
        note=NOTE,
        style=Markup(own_style()),
        script=Markup(theme_script()),
    )  # fmt: skip


def _shown(comparison: Comparison, where: Path) -> dict[str, Any]:
    return {
        "title": title(comparison),
        "definition": comparison.definition,
        "open": comparison.name in CHOSEN,
        "name": comparison.name,
        "rows": [(scenario, [_cell(cell, where) for cell in cells]) for scenario, cells in comparison.rows],
        "strip": strip(comparison, partial(link, where=where)),
        "words": "; ".join(sentences(comparison)),
    }


def _cell(cell: Cell, where: Path) -> dict[str, Any]:
    worst = cell.worst if len(cell.drives) > 1 else None
    return {
        "median": None if cell.median is None else number(cell.median),
        "best": cell.best,
        "count": len(cell.drives),
        "worst": worst and number(worst[1]),
        "seed": worst and worst[0].seed,
        "link": link(worst[0], where) if worst else link(cell.drives[0][0], where) if cell.drives else None,
    }


def link(drive: Drive, where: Path) -> str | None:
    """The address of a run's page from the folder ``where``."""
    return (
        None if drive.page is None else quote(Path(os.path.relpath(drive.page, where.resolve())).as_posix())
    )
