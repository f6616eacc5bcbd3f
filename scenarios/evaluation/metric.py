"""What a metric means, and one measured number: name, value, unit, direction, and the method it is about."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

Better = Literal["lower", "higher"]
Values = dict[str, float | str]
"""Metric name -> its value, or the reason why there is none."""

NO_TRUTH = "the recording has no truth"


@dataclass(frozen=True)
class Definition:
    """Unit, direction (None where neither is better), meaning and blind spot of a metric."""

    unit: str
    better: Better | None
    meaning: str
    cannot_see: str


@dataclass(frozen=True)
class Metric:
    """A number about a method, or the reason why there is none (``value`` None). ``better`` is None where
    neither direction is. Raises ``ValueError`` for a value that is not finite, and for a value with a reason
    or neither."""

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


def absent(names: Iterable[str], reason: str) -> Values:
    """The metrics ``names`` cannot be computed, and why."""
    return dict.fromkeys(names, reason)
