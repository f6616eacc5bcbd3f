"""The scores as tables: a row for each matcher, easy and hard guesses of every kind of pair side by side."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from slam.table import ABSENT, Table

Record = Mapping[str, Any]
CellText = Callable[[Record], str]

DEGREES = 180.0 / math.pi
TIMED_FROM = {"scans": "scans given", "ready": "index and covariances ready", "ranges": "from ranges"}
"""What is counted in the time of a match."""


def number(value: float | None, digits: int = 2, scale: float = 1.0) -> str:
    """``scale`` times a number with so many decimals, or with one digit where it is huge."""
    if value is None:
        return ABSENT
    return f"{scale * value:.{digits}f}" if abs(scale * value) < 1e4 else f"{scale * value:.0e}"


def _percent(share: float | None) -> str:
    return number(share, 1, 100.0)


def _millimetres(values: Sequence[float]) -> str:
    return f"{number(values[0], 1, 1e3)} / {number(values[1], 1, 1e3)}"


TOPICS: tuple[tuple[str, CellText], ...] = (
    (
        "Success: within 0.10 m and 2°, % [95 % interval]",
        lambda r: f"{_percent(r['success'])} [{_percent(r['success_low'])}–{_percent(r['success_high'])}]",
    ),
    (
        "Silent failures / no match, %: beyond the limits and not covered by the claimed 3σ / no answer",
        lambda r: f"{_percent(r['silent'])} / {_percent(r['no_match'])}",
    ),
    (
        "ANEES/3: mean over all answers (from the median); 1 is honest; Intel's truth is a peer's answer",
        lambda r: f"{number(r['anees'])} ({number(r['anees_median'])})",
    ),
    (
        "Error of the successes, rms: mm / °",
        lambda r: f"{number(r['rms_m'], 1, 1e3)} / {number(r['rms_rad'], 2, DEGREES)}",
    ),
    (
        "Processor time of a match, from scans to pose and covariance, ms: median (95 %)",
        lambda r: f"{number(r['ms'])} ({number(r['ms_95'])})",
    ),
)
"""What is shown of the scores, one table each."""


def score_tables(records: Sequence[Record], sections: frozenset[int] = frozenset()) -> list[Table]:
    """A table for each of the `TOPICS` and level of guesses; a line is drawn after the rows ``sections``."""
    matchers, levels, kinds = (
        list(dict.fromkeys(r[name] for r in records)) for name in ("matcher", "guesses", "data")
    )
    by_place = {(r["matcher"], r["guesses"], r["data"]): r for r in records}
    return [
        Table(
            ("matcher", *kinds),
            [(m, *(cell(by_place[m, level, kind]) for kind in kinds)) for m in matchers],
            f"{level} guesses · {title}",
            sections=sections,
        )
        for title, cell in TOPICS
        for level in levels
    ]


def record_table(title: str, records: Sequence[Record], columns: Mapping[str, CellText]) -> Table:
    """One row for each record; ``columns`` by heading, the first two of words."""
    rows = [[cell(record) for cell in columns.values()] for record in records]
    return Table(tuple(columns), rows, title, names=2)


def calibration_table(records: Sequence[Record]) -> Table:
    """Errors beside what the covariances claim."""
    columns: dict[str, CellText] = {
        "place": lambda r: r["place"],
        "method, covariance": lambda r: r["matcher"],
        "rms x / y mm": lambda r: _millimetres(r["rms"]),
        "yaw °": lambda r: number(r["rms"][2], 3, DEGREES),
        "claimed x / y mm": lambda r: _millimetres(r["claimed"]),
        "claimed yaw °": lambda r: number(r["claimed"][2], 3, DEGREES),
        "ANEES/3": lambda r: number(r["anees"]),
        "answers": lambda r: str(r["answers"]),
    }
    return record_table("Calibration: pairs from one place, errors along the world's axes", records, columns)


def efficiency_table(records: Sequence[Record]) -> Table:
    """Efficiency of every matcher."""
    columns: dict[str, CellText] = {
        "pairs": lambda r: r["data"],
        "matcher": lambda r: r["matcher"],
        "translation": lambda r: number(r["translation"]),
        "rotation": lambda r: number(r["rotation"]),
    }
    title = "Efficiency of the successes: Cramér–Rao bound / mean squared error"
    return record_table(title, records, columns)


def speed_table(records: Sequence[Record]) -> Table:
    """Times of every matcher by what is counted in."""

    def timed(way: str) -> CellText:
        return lambda r: f"{number(r[way], 3)} ({number(r[way + '_ratio'], 1)})"

    columns: dict[str, CellText] = {"pairs": lambda r: r["data"], "matcher": lambda r: r["matcher"]}
    columns |= {heading: timed(way) for way, heading in TIMED_FROM.items()}
    title = "Processor time of a match, easy guesses, ms: median (small_gicp GICP / this)"
    return record_table(title, records, columns)
