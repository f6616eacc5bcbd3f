"""The distribution of a metric as a strip plot: a row of dots for each scenario and method."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from scenarios.report.comparison import ALL_SCENARIOS, MethodResult, MetricComparison

LEFT, RIGHT, TOP, ROW, GAP, BOTTOM = 104.0, 400.0, 8.0, 13.0, 12.0, 26.0
"""Ends of the axis, height of a row, between two scenarios and under the last, in the picture's units."""
LOG_RATIO = 20.0
"""The axis is logarithmic where the largest error or cost is so many times the smallest."""


@dataclass(frozen=True)
class Dot:
    """A result in the plot; ``worst`` of its row, with a ``link`` to its page where it has one."""

    x: float
    y: float
    method: int
    result: MethodResult
    value: float
    worst: bool
    link: str | None


@dataclass(frozen=True)
class StripPlot:
    """Dots, the rows' scenarios (name, y), ticks of the axis (words, x), medians (method, x, y), height."""

    dots: tuple[Dot, ...]
    scenarios: tuple[tuple[str, float], ...]
    ticks: tuple[tuple[str, float], ...]
    medians: tuple[tuple[int, float, float], ...]
    height: float
    logarithmic: bool


def strip_plot(comparison: MetricComparison, link: Callable[[MethodResult], str | None]) -> StripPlot:
    """The strip plot of a metric; ``link`` gives the address of a result's page."""
    values = comparison.values
    low, high = min(values), max(values)
    logarithmic = comparison.definition.better != "higher" and low > 0.0 and high > LOG_RATIO * low
    ticks = _decades(low, high) if logarithmic else _steps(min(low, 0.0), high)
    place = _scale(ticks[0], ticks[-1], logarithmic)
    dots, medians, scenarios, y = [], [], [], TOP
    for scenario, cells in comparison.rows:
        if scenario == ALL_SCENARIOS and len(comparison.rows) > 1:
            continue
        scenarios.append((scenario, y + ROW * len(cells) / 2))
        for k, cell in enumerate(cells):
            y += ROW
            for result, value in cell.results:
                worst = cell.worst is not None and cell.worst[0] is result
                dots.append(Dot(place(value), y - ROW / 2, k, result, value, worst, link(result)))
            if cell.median is not None:
                medians.append((k, place(cell.median), y - ROW / 2))
        y += GAP
    labels = tuple((f"{tick:g}", place(tick)) for tick in ticks)
    return StripPlot(tuple(dots), tuple(scenarios), labels, tuple(medians), y + BOTTOM, logarithmic)


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
        a, b, v = map(math.log10, (low, high, value)) if logarithmic else (low, high, value)
        return round(LEFT + (RIGHT - LEFT) * (v - a) / (b - a), 1)

    return place
