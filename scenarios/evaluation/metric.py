"""One measured number: name, value, unit, direction, and the method it is about."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from scenarios.evaluation.definitions import DEFINITIONS

Better = Literal["lower", "higher"]
COST = ("wall_s", "scans_per_s", "peak_mb")


@dataclass(frozen=True)
class Metric:
    """A number about a method, or the reason why there is none (``value`` None).

    ``better`` is None where neither direction is. Raises ``ValueError`` for a value that is not finite, and
    for a value with a reason or neither.
    """

    name: str
    value: float | None
    unit: str
    better: Better | None
    reason: str | None
    method: str

    def __post_init__(self) -> None:
        if (self.value is None) == (self.reason is None):
            raise ValueError(f"metric {self.name}: expected a value or a reason why there is none")
        if self.value is not None and not math.isfinite(self.value):
            raise ValueError(f"metric {self.name}: expected a finite value, got {self.value}")

    def to_json(self) -> dict[str, str | float | None]:
        """The metric as an entry of ``metrics.json``."""
        entry: dict[str, str | float | None] = {
            "method": self.method,
            "metric": self.name,
            "value": self.value,
            "unit": self.unit,
            "better": self.better,
        }
        return entry if self.reason is None else {**entry, "reason": self.reason}


def measured(method: str, values: dict[str, float]) -> list[Metric]:
    """Metrics of one method from ``name -> value``; unit and direction as defined for the name."""
    return [
        Metric(name, float(value), DEFINITIONS[name].unit, DEFINITIONS[name].better, None, method)
        for name, value in values.items()
    ]


def missing(method: str, names: tuple[str, ...], reason: str) -> list[Metric]:
    """Metrics of one method that cannot be computed, and why."""
    return [Metric(n, None, DEFINITIONS[n].unit, DEFINITIONS[n].better, reason, method) for n in names]


def cost(method: str, wall_s: float, scans: int, peak_mb: float | None) -> list[Metric]:
    """What a method took: wall time [s], scans per second, peak memory [MB], None if not measured."""
    metrics = measured(method, {"wall_s": wall_s})
    if wall_s > 0.0:
        metrics += measured(method, {"scans_per_s": scans / wall_s})
    else:
        metrics += missing(method, ("scans_per_s",), "no time passed")
    if peak_mb is None:
        return metrics + missing(method, ("peak_mb",), "peak memory was not measured")
    return metrics + measured(method, {"peak_mb": peak_mb})
