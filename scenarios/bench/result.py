"""What a bench is asked for, what it finds, and how that is printed."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from statistics import median
from typing import Annotated, Any, Literal

from tyro.conf import Positional, arg

from scenarios.bench.suite import BENCHES
from scenarios.stages import timed
from slam.table import Columns, Table

Call = Callable[[], object]
Machine = Mapping[str, Any]

DATA_FOLDER = Path(__file__).resolve().parents[3] / "shared" / "data"
"""Folder of real recordings, beside the checkout."""


@dataclass(frozen=True)
class BenchmarkOptions:
    """Measure on one core, in processor time, and print the median and the range of several repetitions.

    The best repetition is what the code can do; how far the others are from it is what else the machine did.
    matching: also success, honesty and accuracy of scan matchers, beside others (extra [peers]) if installed.
    fuzz: damaged files of every format, on all cores; exit code 1 where one is neither read nor refused.
    """

    name: Positional[Annotated[str, arg(metavar="|".join(BENCHES), help_behavior_hint="")]] = ""
    """Which bench to run; all without a name."""
    format: Literal["table", "json"] = "table"
    """What is printed on stdout; json has everything that was measured."""
    pairs: Annotated[int, arg(metavar="N")] = 300
    """matching: pairs of scans of each kind, simulated and from each log."""
    seed: Annotated[int, arg(metavar="K")] = 0
    """matching: what the pairs, their noise and the guesses are drawn from; fuzz: what the damage is."""
    data: Annotated[Path | None, arg(metavar="FOLDER", help_behavior_hint="")] = None
    """matching: folder of the real recordings (carmen/intel.raw.log.gz, usarsim/iro2012-pre2/Robot1.log),
    by default ../shared/data beside the checkout. What is not there is left out."""
    files: Annotated[int, arg(metavar="N")] = 100_000
    """fuzz: how many files are damaged."""


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

    The calls take turns, so that whatever else the machine does meets all of them.
    """
    seconds: dict[str, list[float]] = {name: [] for name in calls}
    for call in calls.values():
        call()
    for _ in range(repetitions):
        for name, call in calls.items():
            seconds[name].append(timed(call)[1])
    return {name: tuple(times) for name, times in seconds.items()}


def three_digits(value: float) -> str:
    """A number with three digits, none of them behind the point once it has that many before it."""
    if value == 0.0:
        return "0"
    return f"{value:.3g}" if abs(value) < 100.0 else f"{value:.0f}"


def _range(figure: Figure) -> str:
    low, high = min(figure.values), max(figure.values)
    return f"{three_digits(low)}–{three_digits(high)}" if len(figure.values) > 1 else ""


FIGURE_COLUMNS: Columns = (
    ("figure", lambda figure: figure.name),
    ("median", lambda figure: three_digits(figure.median)),
    ("min–max", _range),
    ("unit", lambda figure: figure.unit),
    ("n", lambda figure: str(len(figure.values))),
    ("note", lambda figure: figure.note),
)


def print_result(name: str, result: BenchmarkResult, machine: Machine) -> None:
    """Tables, then median and range of every figure, notes, and the machine, on stdout."""
    for table in result.tables:
        table.print()
    if result.figures:
        Table.of(result.figures, FIGURE_COLUMNS, name).print()
    for note in result.notes:
        print(note)
    versions = ", ".join(f"{name} {machine['packages'][name]}" for name in ("numpy", "numba", "pymunk"))
    print(f"{machine['processor']}, {machine['cores']} cores, Python {machine['python']}, {versions}")


def results_json(results: Mapping[str, BenchmarkResult], machine: Machine) -> str:
    """Every bench's figures with all their repetitions, its records and notes, and the machine."""
    from scenarios.jsonable import document

    return document(
        environment=machine,
        benches={
            name: [
                asdict(f) | {"median": f.median, "min": min(f.values), "max": max(f.values)}
                for f in result.figures
            ]
            for name, result in results.items()
        },
        records={name: result.records for name, result in results.items() if result.records},
        notes={name: result.notes for name, result in results.items() if result.notes},
    )
