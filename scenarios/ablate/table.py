"""A study's lines as a table for the console and as JSON."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from scenarios.ablate.summary import Line, Share


def print_lines(title: str, lines: Sequence[Line], notes: Sequence[str]) -> None:
    """Shares with their intervals, by method and bin, and the notes below."""
    import rich.box
    from rich.console import Console
    from rich.table import Table

    table = Table(title=title, box=rich.box.SIMPLE_HEAD)
    table.add_column("method", no_wrap=True)
    table.add_column("overlap", no_wrap=True)
    for column in ("pairs", "right", "false of accepted", "refused", "ms", "ANEES/3"):
        table.add_column(column, justify="right", no_wrap=True)
    before = ""
    for entry in lines:
        if before and entry.variant != before:
            table.add_section()
        table.add_row(
            entry.variant if entry.variant != before else "",
            entry.bin,
            str(entry.right.n),
            _share(entry.right),
            f"{entry.false.count}/{entry.false.n}",
            _share(entry.refused),
            f"{1e3 * entry.seconds:.0f}",
            "–" if math.isnan(entry.anees) else f"{entry.anees:.2f}",
        )
        before = entry.variant
    console = Console(width=max(120, Console().width), highlight=False)
    console.print(table)
    for note in notes:
        console.print(note, soft_wrap=True)


def _share(share: Share) -> str:
    low, high = share.interval
    return f"{share.value:.2f} [{low:.2f}, {high:.2f}]"


def lines_json(lines: Sequence[Line], about: Mapping[str, object]) -> str:
    """The same as one object; a number that does not exist is null."""
    found = [
        {
            "method": entry.variant,
            "bin": entry.bin,
            "pairs": entry.right.n,
            "accepted": entry.false.n,
            **{
                name: {"count": share.count, "share": _number(share.value), "interval": share.interval}
                for name, share in (
                    ("right", entry.right),
                    ("false", entry.false),
                    ("refused", entry.refused),
                )
            },
            "median_s": entry.seconds,
            "anees": _number(entry.anees),
        }
        for entry in lines
    ]
    return json.dumps({"schema": 1, **about, "lines": found}, indent=2)


def _number(value: float) -> float | None:
    return value if math.isfinite(value) else None
