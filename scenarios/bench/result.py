"""What a bench is asked for, what it finds, and how that is printed."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from statistics import median

from slam.table import Table

Call = Callable[[], object]
Machine = Mapping[str, object]

DATA_FOLDER = Path(__file__).resolve().parents[3] / "shared" / "data"
"""Folder of real recordings, beside the checkout."""


@dataclass(frozen=True)
class BenchmarkOptions:
    """What may be chosen of a bench."""

    pairs: int = 300
    """Pairs of scans of each kind."""
    seed: int = 0
    """What pairs, noise and guesses are drawn from."""
    data: Path = DATA_FOLDER
    """Folder of the real recordings."""
    files: int = 100_000
    """Files that are damaged."""


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


@dataclass(frozen=True)
class BenchmarkResult:
    """``figures`` with their repetitions; ``tables`` for the console, made from ``records`` by topic; and
    ``notes``: what the figures stand for, and what is left out and why. ``failures`` counts what must not
    happen."""

    figures: Sequence[Figure] = ()
    tables: Sequence[Table] = ()
    records: Mapping[str, Sequence[Mapping[str, object]]] = field(default_factory=dict)
    notes: Sequence[str] = ()
    failures: int = 0


def time_calls(calls: Mapping[str, Call], repetitions: int) -> dict[str, tuple[float, ...]]:
    """Processor time [s] of every call in every repetition, after one that is not counted (it may compile).

    On an idle core that is the wall time; on a shared one it leaves out the turns of others. The calls take
    turns, so that whatever else the machine does meets all of them.
    """
    seconds: dict[str, list[float]] = {name: [] for name in calls}
    for call in calls.values():
        call()
    for _ in range(repetitions):
        for name, call in calls.items():
            started = time.process_time()
            call()
            seconds[name].append(time.process_time() - started)
    return {name: tuple(times) for name, times in seconds.items()}


def print_result(name: str, result: BenchmarkResult, machine: Machine) -> None:
    """Tables, then median and range of every figure, notes, and the machine, on stdout."""
    for table in result.tables:
        table.print()
    if result.figures:
        _figure_table(name, result.figures).print()
    for note in result.notes:
        print(note)
    packages = machine["packages"]
    assert isinstance(packages, Mapping)
    versions = ", ".join(f"{name} {packages[name]}" for name in ("numpy", "numba", "pymunk"))
    print(f"{machine['processor']}, {machine['cores']} cores, Python {machine['python']}, {versions}")


def _figure_table(title: str, figures: Sequence[Figure]) -> Table:
    rows = []
    for f in figures:
        spread = f"{three_digits(min(f.values))}–{three_digits(max(f.values))}" if len(f.values) > 1 else ""
        rows.append((f.name, three_digits(f.median), spread, f.unit, str(len(f.values)), f.note))
    return Table(("figure", "median", "min–max", "unit", "n", "note"), rows, title)


def three_digits(value: float) -> str:
    """A number with three digits, none of them behind the point once it has that many before it."""
    if value == 0.0:
        return "0"
    return f"{value:.3g}" if abs(value) < 100.0 else f"{value:.0f}"


def results_json(results: Mapping[str, BenchmarkResult], machine: Machine) -> str:
    """Every bench's figures with all their repetitions, its records and notes, and the machine."""
    figures = {
        name: [
            asdict(f) | {"median": f.median, "min": min(f.values), "max": max(f.values)}
            for f in result.figures
        ]
        for name, result in results.items()
    }
    content = {
        "schema": 1,
        "environment": dict(machine),
        "benches": figures,
        "records": {name: dict(result.records) for name, result in results.items() if result.records},
        "notes": {name: list(result.notes) for name, result in results.items() if result.notes},
    }
    return json.dumps(content, indent=2)
