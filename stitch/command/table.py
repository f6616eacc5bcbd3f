"""The table of pairs when many maps are joined."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from stitch.alignment.result import NoStitch, Stitch
from stitch.command.answer import margin
from stitch.command.map_graph import Pair

UNLIMITED = 10_000
"""More columns than a table needs: the terminal may break its lines."""
COLUMNS = (
    "map",
    "in the frame of",
    "x [m]",
    "y [m]",
    "yaw [°]",
    "overlap [m²]",
    "agreement",
    "margin",
    "verdict",
)


def print_pairs(
    names: Sequence[str], results: dict[Pair, Stitch | NoStitch], trusted: frozenset[Pair]
) -> None:
    """Every pair tried on stdout, answers given between the maps, with the verdict or the reason against."""
    import rich.box
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    table = Table(box=rich.box.SIMPLE_HEAD)
    for k, column in enumerate(COLUMNS):
        table.add_column(Text(column), justify="right" if 2 <= k < 8 else "left", no_wrap=True)
    for (a, b), result in results.items():
        cells = numbers(result)
        table.add_row(*map(Text, (names[b], names[a], *cells, verdict(result, (a, b) in trusted))))
    Console(width=UNLIMITED).print(table)


def numbers(result: Stitch | NoStitch) -> list[str]:
    """x, y, yaw, overlap, agreement and margin as printed."""
    if isinstance(result, NoStitch):
        return [""] * 6
    x, y, yaw = result.T_a_b
    left = margin(result)
    return [
        f"{x:.3f}",
        f"{y:.3f}",
        f"{np.degrees(yaw):.2f}",
        f"{result.overlap_area:.1f}",
        f"{result.agreement:.2f}",
        "" if left is None else f"{left:.2f}",
    ]


def verdict(result: Stitch | NoStitch, trusted: bool) -> str:
    """What became of a pair."""
    if isinstance(result, NoStitch):
        return f"no: {result.reason}"
    return "joined" if trusted else "not used: contradicted, or apart from the first map"
