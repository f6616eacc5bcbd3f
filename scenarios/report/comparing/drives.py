"""Numbers of many drives, from run folders and from the results of sweeps."""

from __future__ import annotations

import csv
import math
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from scenarios.evaluation.definitions import DEFINITIONS
from scenarios.run_folder.place import MARK
from scenarios.run_folder.reading import is_run, read_metrics
from slam.cli import InputError

RESULTS = "results.csv"
"""What a sweep writes: a row per drive and method, a column per metric."""
KEYS = ("scenario", "seed", "method")


@dataclass(frozen=True)
class Drive:
    """One method on one drive: its metrics by name, the run's ``page`` where there is one, and the folder
    they are from."""

    scenario: str
    seed: int
    method: str
    values: dict[str, float]
    page: Path | None
    source: str


def gathered(folders: Sequence[Path]) -> list[Drive]:
    """The drives of all folders, each once, though a link leads there too.

    Where a method has two answers to the same drive, methods are told apart by the folder they are from.
    Raises `InputError` for a folder that is neither a run nor a sweep.
    """
    found = [drive for folder in dict.fromkeys(map(Path.resolve, folders)) for drive in _drives(folder)]
    if not found:
        raise InputError(f"{folders[0]}: holds no drive to compare")
    counts = Counter((drive.scenario, drive.seed, drive.method) for drive in found)
    if max(counts.values()) == 1:
        return found
    return [replace(drive, method=f"{drive.method} ({drive.source})") for drive in found]


def _drives(folder: Path) -> Iterator[Drive]:
    if is_run(folder):
        yield from _of_run(folder)
    elif (folder / RESULTS).is_file():
        yield from _of_sweep(folder)
    else:
        raise InputError(f"{folder}: expected a run, with {MARK}, or a sweep, with {RESULTS}")


def _of_run(folder: Path) -> Iterator[Drive]:
    told, metrics = read_metrics(folder)
    page = folder / "report.html"
    for method in dict.fromkeys(metric.method for metric in metrics):
        values = {m.name: m.value for m in metrics if m.method == method and m.value is not None}
        yield Drive(
            str(told["recording"]), int(told["seed"]), method, values, page if page.is_file() else None,
            folder.parent.name,
        )  # fmt: skip


def _of_sweep(folder: Path) -> Iterator[Drive]:
    path = folder / RESULTS
    with path.open(newline="", encoding="utf-8") as file:
        table = csv.DictReader(file)
        absent = [key for key in KEYS if key not in (table.fieldnames or ())]
        if absent:
            raise InputError(f"{path}: expected a column {absent[0]!r}")
        for row in table:
            try:
                values = {name: float(row[name]) for name in DEFINITIONS if row.get(name)}
                seed = int(row["seed"])
            except ValueError as error:
                raise InputError(f"{path}:{table.line_num}: {error}") from error
            finite = {name: value for name, value in values.items() if math.isfinite(value)}
            yield Drive(row["scenario"], seed, row["method"], finite, None, folder.name)
