"""Where every drive lies, for one metric: a row of dots for each scenario and method."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from scenarios.report.comparing.comparison import EVERYWHERE, Comparison
from scenarios.report.comparing.drives import Drive

LEFT, RIGHT, TOP, ROW, GAP, BOTTOM = 104.0, 400.0, 8.0, 13.0, 12.0, 26.0
"""Ends of the axis, height of a row, between two scenarios and under the last, in the picture's units."""
SPREAD = 20.0
"""The axis is logarithmic where the largest error or cost is so many times the smallest."""


@dataclass(frozen=True)
class Dot:
    """A drive in the picture; ``worst`` of its row, with a ``link`` to its page where it has one."""

    x: float
    y: float
    method: int
    drive: Drive
    value: float
    worst: bool
    link: str | None


@dataclass(frozen=True)
class Strip:
    """Dots, the rows' scenarios (name, y), ticks of the axis (words, x), medians (method, x, y), height."""

    dots: tuple[Dot, ...]
    scenarios: tuple[tuple[str, float], ...]
    ticks: tuple[tuple[str, float], ...]
    medians: tuple[tuple[int, float, float], ...]
    height: float
    logarithmic: bool


def strip(comparison: Comparison, link: Callable[[Drive], str | None]) -> Strip:
    """The picture of a metric's distribution; ``link`` tells where a drive's page is."""
    values = comparison.values
    low, high = min(values), max(values)
    logarithmic = comparison.definition.better != "higher" and low > 0.0 and high > SPREAD * low
    ticks = _decades(low, high) if logarithmic else _steps(min(low, 0.0), high)
    place = _scale(ticks[0], ticks[-1], logarithmic)
    dots, medians, scenarios, y = [], [], [], TOP
    for scenario, cells in comparison.rows:
        if scenario == EVERYWHERE and len(comparison.rows) > 1:
            continue
        scenarios.append((scenario, y + ROW * len(cells) / 2))
        for k, cell in enumerate(cells):
            y += ROW
            for drive, value in cell.drives:
                worst = cell.worst is not None and cell.worst[0] is drive
                dots.append(Dot(place(value), y - ROW / 2, k, drive, value, worst, link(drive)))
            if cell.median is not None:
                medians.append((k, place(cell.median), y - ROW / 2))
        y += GAP
    words = tuple((f"{tick:g}", place(tick)) for tick in ticks)
    return Strip(tuple(dots), tuple(scenarios), words, tuple(medians), y + BOTTOM, logarithmic)


def _decades(low: float, high: float) -> list[float]:
    return [10.0**k for k in range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)]


def _steps(low: float, high: float) -> list[float]:
    """About five round numbers from below ``low`` to above ``high``."""
    width = max(high - low, 1e-9) / 4.0
    power = 10.0 ** math.floor(math.log10(width))
    step = next(power * factor for factor in (1.0, 2.0, 5.0, 10.0) if power * factor >= width)
    first, last = math.floor(low / step), math.ceil(high / step)
    return [round(step * k, 12) for k in range(first, max(last, first + 1) + 1)]


def _scale(low: float, high: float, logarithmic: bool) -> Callable[[float], float]:
    def place(value: float) -> float:
        a, b, v = (
            (math.log10(low), math.log10(high), math.log10(value)) if logarithmic else (low, high, value)
        )
        return round(LEFT + (RIGHT - LEFT) * (v - a) / (b - a), 1)

    return place


def sentences(comparison: Comparison) -> Sequence[str]:
    """The picture in words: which method has the best median in which scenario."""
    return [
        f"{scenario}: {method}"
        for scenario, cells in comparison.rows
        for method, cell in zip(comparison.methods, cells, strict=True)
        if cell.best
    ]
