"""Rows of answers into shares with intervals, by method and bin."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtri

from scenarios.ablate.trial import Row


@dataclass(frozen=True)
class Share:
    """``count`` of ``n``, and its 95 % interval (Wilson 1927)."""

    count: int
    n: int

    @property
    def value(self) -> float:
        """The share itself; NaN of nothing."""
        return self.count / self.n if self.n else float("nan")

    @property
    def interval(self) -> tuple[float, float]:
        """Lower and upper limit."""
        if self.n == 0:
            return 0.0, 1.0
        z = float(ndtri(0.975))
        middle = (self.count + 0.5 * z**2) / (self.n + z**2)
        half = z / (self.n + z**2) * np.sqrt(self.count * (self.n - self.count) / self.n + 0.25 * z**2)
        return max(0.0, float(middle - half)), min(1.0, float(middle + half))


@dataclass(frozen=True)
class Line:
    """One method in one bin: shares of all pairs, but ``false`` of the accepted; processor time in s.

    ``anees`` is that of the right stitches, divided by 3 (a false one is beyond any covariance); NaN where
    none has a covariance.
    """

    variant: str
    bin: str
    right: Share
    false: Share
    refused: Share
    seconds: float
    anees: float


ALL = "all"
"""The bin of all bins together."""


def lines(rows: Sequence[Row], bins: Iterable[str]) -> list[Line]:
    """A line per method and bin that has pairs, and one over all bins for each method."""
    found = []
    for variant in dict.fromkeys(row.variant for row in rows):
        own = [row for row in rows if row.variant == variant]
        for name in bins:
            inside = [row for row in own if row.bin == name]
            if inside:
                found.append(line(variant, name, inside))
        found.append(line(variant, ALL, own))
    return found


def line(variant: str, name: str, rows: Sequence[Row]) -> Line:
    """What a method did with some pairs."""
    counts = {
        outcome: sum(row.outcome == outcome for row in rows) for outcome in ("right", "false", "refused")
    }
    nees = np.array([row.nees if row.outcome == "right" else np.nan for row in rows])
    nees = nees[np.isfinite(nees)]
    return Line(
        variant,
        name,
        right=Share(counts["right"], len(rows)),
        false=Share(counts["false"], counts["right"] + counts["false"]),
        refused=Share(counts["refused"], len(rows)),
        seconds=float(np.median([row.seconds for row in rows])),
        anees=float(nees.mean()) / 3.0 if len(nees) else float("nan"),
    )
