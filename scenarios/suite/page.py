"""All submissions side by side, as one HTML file that opens without a network."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from markupsafe import Markup

from scenarios.report.html import TEMPLATES, read, template, theme_script
from scenarios.suite.options import PageOptions
from scenarios.suite.row import SCORED, Row, read_row
from scenarios.suite.significance import SURE, compare, friedman, mean_ranks
from scenarios.suite.table import COLUMNS, NOTE, table
from scenarios.suite.version import suite
from slam.cli import InputError
from slam.table import number

HERE = Path(__file__).parent
FEWEST = 6
"""Recordings below which Wilcoxon's test is sure of nothing at 0.05."""


def run(options: PageOptions) -> None:
    """Write the page and print its table. Raises `InputError`, and writes nothing then."""
    if not options.rows:
        raise InputError("expected one or more rows, as score writes them with -o")
    rows = [read_row(path) for path in options.rows]
    check_comparable(rows, options.rows)
    text = render(rows)
    try:
        options.out.write_text(text, encoding="utf-8")
    except OSError as error:
        raise InputError(f"--out {options.out}: cannot be written: {error.strerror}") from error
    found = table(rows)
    shown = {"table": found.console, "markdown": found.markdown, "latex": found.latex}[options.format]
    print(shown())
    print(options.out)


def check_comparable(rows: Sequence[Row], paths: Sequence[Path]) -> None:
    """Raises `InputError` for rows of unlike recordings, tolerance or split, and for two of one name."""
    first, names = rows[0], [row.name for row in rows]
    for row, path in zip(rows, paths, strict=True):
        if names.count(row.name) > 1:
            raise InputError(
                f"{path}: two rows are called {row.name!r}, expected names of their own (--name)"
            )
        if (row.split, row.tolerance) != (first.split, first.tolerance):
            theirs, ours = (f"{r.split}, {r.tolerance:g} s" for r in (row, first))
            raise InputError(f"{path}: scored on {theirs}, expected {ours} as {paths[0]}")
        if set(row.results) != set(first.results):
            raise InputError(f"{path}: scored on {len(row.results)} recordings, expected those of {paths[0]}")
        for name, result in row.results.items():
            if result.fingerprint != first.results[name].fingerprint:
                raise InputError(f"{path}: its {name} is another recording than that of {paths[0]}")


def render(rows: Sequence[Row]) -> str:
    """The page. Everything that comes from outside is escaped."""
    names = list(rows[0].results)
    errors = [row.errors(names) for row in rows]
    ranks = mean_ranks(errors)
    order = sorted(range(len(rows)), key=lambda k: (ranks[k], rows[k].name))
    best = [min(column) for column in zip(*errors, strict=True)]
    found = table(rows)
    return template("suite.html.j2", HERE / "templates").render(
        suite=suite().name,
        split=rows[0].split,
        rows=[rows[k] for k in order],
        columns=COLUMNS,
        cells=[[str(cell) for cell in row] for row in found.rows],
        note=NOTE,
        names=names,
        best=dict(zip(names, best, strict=True)),
        traps=suite().traps,
        pairs=[
            {"a": rows[one.a].name, "b": rows[one.b].name, "wins": one.wins, "losses": one.losses}
            | {"p": f"{one.p:.2g}", "sure": one.p < SURE}
            for one in compare(errors)
        ],
        friedman=friedman(errors),
        too_few=len(names) < FEWEST,
        frozen=all(result.frozen for row in rows for result in row.results.values()),
        scored=SCORED,
        number=number,
        style=Markup(read(TEMPLATES / "page.css")),
        script=Markup(theme_script()),
    )  # fmt: skip
