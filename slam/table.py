"""One table for everything that is printed: console, Markdown, LaTeX and HTML."""

from __future__ import annotations

import html
import io
import re
import sys
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

ABSENT = "–"
"""What stands where there is no number."""
UNLIMITED = 10_000
"""More columns than a table needs: a number cut short would be a wrong number, the terminal may wrap."""
LATEX = {
    "\\": r"\textbackslash{}", "&": r"\&", "%": r"\%", "$": r"\$", "#": r"\#", "_": r"\_", "{": r"\{",
    "}": r"\}", "~": r"\textasciitilde{}", "^": r"\textasciicircum{}", "↓": r"$\downarrow$",
    "↑": r"$\uparrow$", "°": r"$^\circ$", "²": r"$^2$", "±": r"$\pm$", "×": r"$\times$", ABSENT: "--",
}  # fmt: skip


@dataclass(frozen=True)
class Bold:
    """The text of a cell that is set in bold."""

    text: str

    def __str__(self) -> str:
        return self.text


Cell = str | Bold
Columns = Sequence[tuple[str, Callable[[Any], Cell]]]
"""Headings, each with the function that makes the cell of a record."""


@dataclass(frozen=True)
class Table:
    """Text in ``rows`` under ``columns``; the first ``names`` columns are words, the others numbers.

    A rule is drawn after the rows (counted from 0) in ``sections``; ``notes`` stand below.
    """

    columns: Sequence[str]
    rows: Sequence[Sequence[Cell]]
    title: str = ""
    names: int = 1
    sections: frozenset[int] = frozenset()
    notes: Sequence[str] = ()

    def __post_init__(self) -> None:
        for row in self.rows:
            if len(row) != len(self.columns):
                raise ValueError(f"expected {len(self.columns)} cells in a row, got {len(row)}: {row}")

    @classmethod
    def of(
        cls,
        records: Iterable[object],
        columns: Columns,
        title: str = "",
        names: int = 1,
        notes: Sequence[str] = (),
    ) -> Table:
        """A row for every record, whose cells the ``columns`` make of it."""
        rows = [[cell(record) for _, cell in columns] for record in records]
        return cls([heading for heading, _ in columns], rows, title, names, notes=notes)

    def grouped(self, by: int = 1) -> Table:
        """The same with a rule wherever one of the first ``by`` columns changes, and its value said once."""
        rows, sections = [], set()
        for k, row in enumerate(self.rows):
            before = self.rows[k - 1][:by] if k else None
            if before is not None and tuple(before) != tuple(row[:by]):
                sections.add(k - 1)
            repeated = before is not None and tuple(before) == tuple(row[:by])
            rows.append((*([""] * by if repeated else row[:by]), *row[by:]))
        return Table(self.columns, rows, self.title, self.names, frozenset(sections), self.notes)

    def print(self) -> None:
        """The table on stdout, as wide as it needs to be; bold where a terminal reads it."""
        print(self.console(styled=sys.stdout.isatty()))

    def console(self, styled: bool = False) -> str:
        """The table for a terminal, with escape sequences only where it is ``styled``."""
        import rich.box
        import rich.table
        from rich.console import Console
        from rich.text import Text

        drawn = rich.table.Table(
            title=Text(self.title) if self.title else None, title_justify="left", box=rich.box.SIMPLE_HEAD
        )
        for k, column in enumerate(self.columns):
            side = "left" if k < self.names else "right"
            drawn.add_column(Text(column), justify=side, vertical="bottom", no_wrap=True)  # type: ignore[arg-type]
        for k, row in enumerate(self.rows):
            cells = [Text(str(cell), style="bold" if isinstance(cell, Bold) else "") for cell in row]
            drawn.add_row(*cells, end_section=k in self.sections)
        console = Console(width=UNLIMITED, file=io.StringIO(), record=True, highlight=False)
        console.print(drawn)
        return "\n".join([console.export_text(styles=styled).rstrip(), *self.notes])

    def markdown(self) -> str:
        """The table as GitHub has it."""
        head = [_line(self.columns, _markdown, "**"), "|---" * self.names]
        head[1] += "|---:" * (len(self.columns) - self.names) + "|"
        title = [_markdown(self.title), ""] if self.title else []
        below = ["", *map(_markdown, self.notes)] if self.notes else []
        return "\n".join([*title, *head, *(_line(row, _markdown, "**") for row in self.rows), *below])

    def latex(self) -> str:
        """The table for LaTeX with the package booktabs; the title is its caption."""
        rows = [
            " & ".join(_set(cell, _latex, r"\textbf{", "}") for cell in row) + r" \\" for row in self.rows
        ]
        for k in sorted(self.sections, reverse=True):
            rows.insert(k + 1, r"\midrule")
        return "\n".join(
            [
                r"\begin{table}",
                rf"\caption{{{_latex(self.title)}}}",
                rf"\begin{{tabular}}{{{'l' * self.names}{'r' * (len(self.columns) - self.names)}}}",
                r"\toprule",
                " & ".join(map(_latex, self.columns)) + r" \\",
                r"\midrule",
                *rows,
                r"\bottomrule",
                r"\end{tabular}",
                *(rf"\\ {_latex(note)}" for note in self.notes),
                r"\end{table}",
            ]
        )

    def html(self) -> str:
        """The table as HTML, numbers in cells of the class ``number``."""

        def cells(row: Sequence[Cell], tag: str) -> str:
            classes = ["" if k < self.names else ' class="number"' for k in range(len(row))]
            texts = [_set(cell, html.escape, "<b>", "</b>") for cell in row]
            return "".join(f"<{tag}{c}>{text}</{tag}>" for c, text in zip(classes, texts, strict=True))

        caption = f"<caption>{html.escape(self.title)}</caption>" if self.title else ""
        body = "\n".join(f"<tr>{cells(row, 'td')}</tr>" for row in self.rows)
        notes = "".join(f"\n<p>{html.escape(note)}</p>" for note in self.notes)
        head = f"<thead><tr>{cells(self.columns, 'th')}</tr></thead>"
        return f"<table>{caption}\n{head}\n<tbody>\n{body}\n</tbody></table>{notes}"


def number(value: float | None, decimals: int = 3) -> str:
    """A number with so many decimals; `ABSENT` where there is none."""
    return ABSENT if value is None or value != value else f"{value:.{decimals}f}"


def with_interval(value: float, low: float, high: float, decimals: int = 2) -> str:
    """A number with its interval in brackets, without where that does not exist."""
    if not low > float("-inf"):
        return number(value, decimals)
    return f"{number(value, decimals)} [{number(low, decimals)}, {number(high, decimals)}]"


def _set(cell: Cell, escape: Callable[[str], str], before: str, after: str) -> str:
    text = escape(str(cell))
    return f"{before}{text}{after}" if isinstance(cell, Bold) else text


def _line(row: Sequence[Cell], escape: Callable[[str], str], mark: str) -> str:
    return "| " + " | ".join(_set(cell, escape, mark, mark) for cell in row) + " |"


def _markdown(text: str) -> str:
    return re.sub(r"([|\\`*_<>\[\]])", r"\\\1", text)


def _latex(text: str) -> str:
    return "".join(LATEX.get(character, character) for character in text)
