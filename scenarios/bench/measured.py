"""What a bench found, and what it had been asked for."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from scenarios.bench.figure import Figure

DATA = Path(__file__).resolve().parents[3] / "shared" / "data"
"""Folder of real recordings, beside the checkout."""


@dataclass(frozen=True)
class Asked:
    """How many ``pairs`` of scans of each kind, drawn from which ``seed``, and the folder of recordings."""

    pairs: int = 300
    seed: int = 0
    data: Path = DATA


@dataclass(frozen=True)
class Table:
    """Figures side by side, as text; the first ``names`` columns are words; ``sections`` are rows after which
    a line is drawn."""

    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    sections: frozenset[int] = frozenset()
    names: int = 1


@dataclass(frozen=True)
class Measured:
    """``figures`` with their repetitions; ``tables`` for the console, made from ``records`` by topic; and
    ``notes``: what the figures stand for, and what is left out and why."""

    figures: Sequence[Figure] = ()
    tables: Sequence[Table] = ()
    records: Mapping[str, Sequence[Mapping[str, object]]] = field(default_factory=dict)
    notes: Sequence[str] = ()
