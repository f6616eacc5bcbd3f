"""A measured figure: several repetitions of it, and what it is."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from statistics import median

Call = Callable[[], object]


@dataclass(frozen=True)
class Figure:
    """One measured quantity: its ``values``, one for each repetition, and a note on the conditions."""

    name: str
    unit: str
    values: tuple[float, ...]
    note: str = ""

    @property
    def median(self) -> float:
        """Median over the repetitions."""
        return median(self.values)

    def per(self, other: Figure, name: str, note: str = "") -> Figure:
        """How many times ``other`` this is, repetition by repetition."""
        return Figure(name, "×", tuple(a / b for a, b in zip(self.values, other.values, strict=True)), note)


def seconds(calls: Mapping[str, Call], repetitions: int) -> dict[str, tuple[float, ...]]:
    """Processor time [s] of every call in every repetition, after one that is not counted (it may compile).

    On an idle core that is the wall time; on a shared one it leaves out the turns of others. The calls take
    turns, so that whatever else the machine does meets all of them.
    """
    taken: dict[str, list[float]] = {name: [] for name in calls}
    for call in calls.values():
        call()
    for _ in range(repetitions):
        for name, call in calls.items():
            started = time.process_time()
            call()
            taken[name].append(time.process_time() - started)
    return {name: tuple(times) for name, times in taken.items()}
