"""The scores as tables: a row for each matcher, easy and hard guesses of every kind of pair side by side."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

from scenarios.bench.measured import Table

Record = Mapping[str, Any]
Cell = Callable[[Record], str]


def percent(share: float | None) -> str:
    """A share as a percentage with one decimal."""
    return "–" if share is None else f"{100.0 * share:.1f}"


def decimals(value: float | None, digits: int = 2, scale: float = 1.0) -> str:
    """A number with so many decimals, or a dash."""
    if value is None:
        return "–"
    return f"{scale * value:.{digits}f}" if abs(scale * value) < 1e4 else f"{scale * value:.0e}"


DEGREES = 180.0 / math.pi
WAYS = {"scans": "scans given", "ready": "index and covariances ready", "ranges": "from ranges"}
"""What is counted in the time of a match."""

TOPICS: tuple[tuple[str, Cell], ...] = (
    (
        "Success: within 0.10 m and 2°, % [95 % interval]",
        lambda r: f"{percent(r['success'])} [{percent(r['success_low'])}–{percent(r['success_high'])}]",
    ),
    (
        "Silent failures / no match, %: beyond the limits and not covered by the claimed 3σ / no answer",
        lambda r: f"{percent(r['silent'])} / {percent(r['no_match'])}",
    ),
    (
        "ANEES/3: mean over all answers (from the median); 1 is honest; Intel's truth is a peer's answer",
        lambda r: f"{decimals(r['anees'])} ({decimals(r['anees_median'])})",
    ),
    (
        "Error of the successes, rms: mm / °",
        lambda r: f"{decimals(r['rms_m'], 1, 1e3)} / {decimals(r['rms_rad'], 2, DEGREES)}",
    ),
    (
        "Processor time of a match, from scans to pose and covariance, ms: median (95 %)",
        lambda r: f"{decimals(r['ms'])} ({decimals(r['ms_95'])})",
    ),
)
"""What is shown of the scores, one table each."""


def score_tables(records: Sequence[Record], groups: Iterable[int] = ()) -> list[Table]:
    """A table for each of the `TOPICS` and level of guesses; ``groups`` are the rows after which a line is
    drawn."""
    matchers = list(dict.fromkeys(r["matcher"] for r in records))
    levels = list(dict.fromkeys(r["guesses"] for r in records))
    kinds = list(dict.fromkeys(r["data"] for r in records))
    by_place = {(r["matcher"], r["guesses"], r["data"]): r for r in records}
    return [
        Table(
            f"{level} guesses · {title}",
            ("matcher", *kinds),
            tuple((m, *(cell(by_place[m, level, kind]) for kind in kinds)) for m in matchers),
            frozenset(groups),
        )
        for title, cell in TOPICS
        for level in levels
    ]


def calibration_table(records: Sequence[Record]) -> Table:
    """Errors beside what the covariances claim."""
    columns: dict[str, Cell] = {
        "place": lambda r: r["place"],
        "method, covariance": lambda r: r["matcher"],
        "rms x / y mm": lambda r: _millimetres(r["rms"]),
        "yaw °": lambda r: decimals(r["rms"][2], 3, DEGREES),
        "claimed x / y mm": lambda r: _millimetres(r["claimed"]),
        "claimed yaw °": lambda r: decimals(r["claimed"][2], 3, DEGREES),
        "ANEES/3": lambda r: decimals(r["anees"]),
        "answers": lambda r: str(r["answers"]),
    }
    return _table("Calibration: pairs from one place, errors along the world's axes", records, columns)


def efficiency_table(records: Sequence[Record]) -> Table:
    """Efficiency of every matcher."""
    columns: dict[str, Cell] = {
        "pairs": lambda r: r["data"],
        "matcher": lambda r: r["matcher"],
        "translation": lambda r: decimals(r["translation"]),
        "rotation": lambda r: decimals(r["rotation"]),
    }
    return _table("Efficiency of the successes: Cramér–Rao bound / mean squared error", records, columns)


def speed_table(records: Sequence[Record]) -> Table:
    """Times of every matcher by what is counted in."""
    columns: dict[str, Cell] = {"pairs": lambda r: r["data"], "matcher": lambda r: r["matcher"]}
    columns |= {heading: _timed(way) for way, heading in WAYS.items()}
    title = "Processor time of a match, easy guesses, ms: median (small_gicp GICP / this)"
    return _table(title, records, columns)


def _timed(way: str) -> Cell:
    return lambda r: f"{decimals(r[way], 3)} ({decimals(r[way + '_ratio'], 1)})"


def _millimetres(values: Sequence[float]) -> str:
    return f"{decimals(values[0], 1, 1e3)} / {decimals(values[1], 1, 1e3)}"


def _table(title: str, records: Sequence[Record], columns: Mapping[str, Cell]) -> Table:
    """One row for each record; ``columns`` by heading, the first two of words."""
    rows = tuple(tuple(cell(r) for cell in columns.values()) for r in records)
    return Table(title, tuple(columns), rows, names=2)
