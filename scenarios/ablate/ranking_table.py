"""Summaries of methods and their paired ratios as tables and as JSON."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence

from scenarios.ablate.method_variants import DriveResult
from scenarios.ablate.paired_comparison import MethodSummary, PairedRatio
from scenarios.jsonable import jsonable
from slam.table import ABSENT, Table, number, with_interval

COLUMNS = (
    "scenario", "method", "drives", "ate_rmse", "worst", "map_f1", "worst", "false", "ANEES", "at end", "s",
)  # fmt: skip
NOTES = (
    "worst: of all drives (which seed); false: of the accepted stitches, off by more than 0.3 m or 2°; "
    "s: median processor time",
    "ANEES: mean over drives of their poses' average, 1 is honest; at end: of the last poses alone, with the "
    "band in which 95 % of honest ones lie",
    "ratio: of ate_rmse on the same drive, below 1 where the first is better: median [95 % interval]",
)


def ranking_table(title: str, summaries: Sequence[MethodSummary], notes: Sequence[str] = NOTES) -> Table:
    """A row per scenario and method."""
    rows = [
        (
            one.scenario,
            one.method,
            f"{one.drives}" if one.failed == 0 else f"{one.drives} ({one.failed} failed)",
            number(one.ate_rmse, 3),
            _worst(one.worst_ate_rmse, one.worst_ate_drive, one.scenario, 3),
            number(one.map_f1, 2),
            _worst(one.worst_map_f1, one.worst_map_drive, one.scenario, 2),
            ABSENT if one.accepted is None else f"{one.false}/{one.accepted}",
            number(one.anees, 2),
            with_interval(one.anees_last, *one.band),
            number(one.seconds, 1),
        )
        for one in summaries
    ]
    return Table(COLUMNS, rows, title, names=2, notes=notes).grouped()


def ratio_table(ratios: Sequence[PairedRatio], notes: Sequence[str] = NOTES) -> Table:
    """A row per comparison on the same drives."""
    rows = [
        (
            one.scenario,
            one.method,
            one.against,
            str(one.drives),
            with_interval(one.ratio, *one.interval),
            f"{one.better:.0%}",
            number(one.worst, 2),
            one.worst_drive,
        )
        for one in ratios
    ]
    columns = ("scenario", "method", "against", "drives", "ratio", "better", "worst", "where")
    return Table(columns, rows, "On the same drives", names=3, notes=notes).grouped()


def _worst(value: float, drive: str, scenario: str, decimals: int) -> str:
    """A worst value and its drive, of which the scenario need not be said twice."""
    return f"{number(value, decimals)} ({drive.removeprefix(scenario).strip()})" if drive else ABSENT


def print_ranking(title: str, summaries: Sequence[MethodSummary], ratios: Sequence[PairedRatio]) -> None:
    """Both tables on stdout, and what their columns mean."""
    ranking_table(title, summaries, () if ratios else NOTES).print()
    if ratios:
        ratio_table(ratios).print()


def ranking_json(
    summaries: Sequence[MethodSummary],
    ratios: Sequence[PairedRatio],
    failed: Sequence[DriveResult],
    about: Mapping[str, object],
) -> str:
    """The same as one object; a number that does not exist is null."""
    errors = [
        {"scenario": one.scenario, "seed": one.seed, "method": one.method, "error": one.error}
        for one in failed
    ]
    content = {"schema": 1, **about, "standings": summaries, "comparisons": ratios, "failed": errors}
    return json.dumps(jsonable(content), indent=2)
