"""Kinds of corruption, and one of them at a severity."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from slam.recording import Recording

Spoil = Callable[[Recording, float, np.random.Generator], Recording]
"""Recording, severity, what draws → the spoilt recording. Raises ``ValueError`` for one that is too short."""
LEVELS = ("low", "medium", "high")


@dataclass(frozen=True)
class Severity:
    """How much of a corruption there can be."""

    meaning: str
    """What the number says."""
    unit: str
    """Its unit; empty for shares and factors."""
    least: float
    """Least value that is allowed."""
    most: float
    """Largest value that is allowed."""
    levels: tuple[float, float, float]
    """What counts as low, medium and high."""
    default: float
    """What is taken where nobody says how much."""
    whole: bool = False
    """Whether it is a count."""


@dataclass(frozen=True)
class Kind:
    """One way in which a recording can be spoilt."""

    name: str
    """Of what, and how: ``odometry.frozen``."""
    does: str
    """What it does to a recording, in words."""
    spoil: Spoil
    """The function that does it."""
    severity: Severity | None = None
    """How much; None where there is only yes or no."""
    drawn: bool = True
    """Whether chance has a part in it."""
    needs_dead_reckoning: bool = False
    """Whether there must be dead reckoning to spoil."""

    def at(self, severity: float | None = None) -> Corruption:
        """This corruption at a severity, its default where none is given. Raises ``ValueError``."""
        if self.severity is None:
            if severity is not None:
                raise ValueError(f"{self.name}: is there or not, expected no severity")
            return Corruption(self, None)
        value = self.severity.default if severity is None else severity
        least, most, whole = self.severity.least, self.severity.most, self.severity.whole
        if not least <= value <= most or (whole and value != math.floor(value)):
            number = "a whole number" if whole else "a number"
            limits = f"from {least:g} to {most:g} {self.severity.unit}".rstrip()
            raise ValueError(
                f"{self.name}: expected {number} {limits} ({self.severity.meaning}), got {value:g}"
            )
        return Corruption(self, float(value))

    def levels(self) -> list[tuple[str, Corruption]]:
        """The corruption at each level, with its name; of one that is there or not a single one."""
        if self.severity is None:
            return [("", self.at())]
        return [(level, self.at(v)) for level, v in zip(LEVELS, self.severity.levels, strict=True)]


@dataclass(frozen=True)
class Corruption:
    """A kind at a severity that it allows."""

    kind: Kind
    severity: float | None

    def __str__(self) -> str:
        return self.kind.name if self.severity is None else f"{self.kind.name}={self.severity:g}"

    def apply(self, recording: Recording, rng: np.random.Generator) -> Recording:
        """The spoilt recording, which says so. Truth, relations and the full-rate odometry, by which poses
        are scored, are as before. Raises ``ValueError`` for a recording that lacks what is spoilt."""
        if self.kind.needs_dead_reckoning and recording.source == "none":
            raise ValueError(f"{self}: the recording has no dead reckoning")
        severity = 1.0 if self.severity is None else self.severity
        spoilt = self.kind.spoil(recording, severity, rng)
        return replace(spoilt, corruptions=(*recording.corruptions, str(self)))
