"""The table of a study as a file."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from slam.cli import InputError


def write_results(path: Path, columns: Sequence[str], rows: Iterable[Mapping[str, object]]) -> None:
    """Rows as CSV, whole or not at all. Raises `InputError` where the disk will not have it."""
    partial = path.with_name(f"{path.name}.partial")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with partial.open("w", newline="") as file:
            table = csv.DictWriter(file, columns, restval="")
            table.writeheader()
            table.writerows(rows)
        partial.replace(path)
    except OSError as error:
        raise InputError(f"{path}: {error.strerror or error}") from error
