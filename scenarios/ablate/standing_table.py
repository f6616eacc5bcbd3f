"""Standings and comparisons as tables for the console and as JSON."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.table import Table

    from scenarios.ablate.drives import Drive
    from scenarios.ablate.standing import Comparison, Standing

WIDTH = 240
"""Wider than any table: no number is cut short."""

NOTES = (
    "worst: of all drives (which seed); false: of the accepted stitches, off by more than 0.3 m or 2°; "
    "s: median processor time",
    "ANEES: mean over drives of their poses' average, 1 is honest; at end: of the last poses alone, with the "
    "band in which 95 % of honest ones lie",
    "ratio: of ate_rmse on the same drive, below 1 where the first is better: median [95 % interval]",
)


def print_standings(title: str, standings: Sequence[Standing], comparisons: Sequence[Comparison]) -> None:
    """Both tables on stdout, and what their columns mean."""
    from rich.console import Console

    console = Console(width=WIDTH, highlight=False)
    console.print(_standing_table(title, standings))
    if comparisons:
        console.print(_comparison_table(comparisons))
    for note in NOTES:
        console.print(note, soft_wrap=True)


def _standing_table(title: str, standings: Sequence[Standing]) -> Table:
    table = _table(title, ("scenario", "method"))
    for column in ("drives", "ate_rmse", "worst", "map_f1", "worst", "false", "ANEES", "at end", "s"):
        table.add_column(column, justify="right", no_wrap=True)
    before = ""
    for one in standings:
        if before and one.scenario != before:
            table.add_section()
        table.add_row(
            one.scenario if one.scenario != before else "",
            one.method,
            f"{one.drives}" if one.failed == 0 else f"{one.drives} ({one.failed} failed)",
            _number(one.ate_rmse, 3),
            _named(one.worst_ate_rmse, 3, one.worst_ate_drive, one.scenario),
            _number(one.map_f1, 2),
            _named(one.worst_map_f1, 2, one.worst_map_drive, one.scenario),
            "–" if one.accepted is None else f"{one.false}/{one.accepted}",
            _number(one.anees, 2),
            _with_interval(one.anees_last, one.band),
            _number(one.seconds, 1),
        )
        before = one.scenario
    return table


def _comparison_table(comparisons: Sequence[Comparison]) -> Table:
    table = _table("On the same drives", ("scenario", "method", "against"))
    for column in ("drives", "ratio", "better", "worst", "where"):
        table.add_column(column, justify="right", no_wrap=True)
    before = ""
    for one in comparisons:
        if before and one.scenario != before:
            table.add_section()
        table.add_row(
            one.scenario if one.scenario != before else "",
            one.method,
            one.against,
            str(one.drives),
            _with_interval(one.ratio, one.interval),
            f"{one.better:.0%}",
            _number(one.worst, 2),
            one.worst_drive,
        )
        before = one.scenario
    return table


def _table(title: str, names: Sequence[str]) -> Table:
    import rich.box
    from rich.table import Table

    table = Table(title=title, box=rich.box.SIMPLE_HEAD)
    for name in names:
        table.add_column(name, no_wrap=True)
    return table


def _number(value: float, digits: int) -> str:
    return f"{value:.{digits}f}" if math.isfinite(value) else "–"


def _named(value: float, digits: int, drive: str, scenario: str) -> str:
    """A worst value and its drive, of which the scenario need not be said twice."""
    return f"{value:.{digits}f} ({drive.removeprefix(scenario).strip()})" if drive else "–"


def _with_interval(value: float, interval: tuple[float, float]) -> str:
    low, high = interval
    if not math.isfinite(low):
        return _number(value, 2)
    return f"{value:.2f} [{low:.2f}, {high:.2f}]"


def standings_json(
    standings: Sequence[Standing],
    comparisons: Sequence[Comparison],
    failed: Sequence[Drive],
    about: Mapping[str, object],
) -> str:
    """The same as one object; a number that does not exist is null."""
    content = {
        "schema": 1,
        **about,
        "standings": [asdict(one) for one in standings],
        "comparisons": [asdict(one) for one in comparisons],
        "failed": [
            {"scenario": row.scenario, "seed": row.seed, "method": row.method, "error": row.error}
            for row in failed
        ],
    }
    return json.dumps(_plain(content), indent=2)


def _plain(value: object) -> object:
    """Numbers that are none as None, all the way down."""
    if isinstance(value, dict):
        return {key: _plain(inner) for key, inner in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(inner) for inner in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
