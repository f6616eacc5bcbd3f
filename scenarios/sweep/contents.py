"""What the file of a sweep holds, for reading."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

from scenarios.sweep.store import complaint
from slam.cli import InputError


def contents(path: Path) -> Iterator[str]:
    """Lines: answers, failures and seconds per trial by study and method, then every traceback.

    Raises `InputError` where the file is none of a sweep's.
    """
    if not path.is_file():
        raise InputError(f"{path}: expected the file of a sweep")
    try:
        with closing(sqlite3.connect(f"{path.resolve().as_uri()}?mode=ro", uri=True, timeout=0.0)) as file:
            yield from _counts(file)
            yield from _tracebacks(file)
    except sqlite3.Error as error:
        raise InputError(f"{path}: {complaint(error)}") from error


def _counts(file: sqlite3.Connection) -> Iterator[str]:
    found = file.execute(
        "SELECT study, method, version, count(*), sum(traceback IS NOT NULL), avg(seconds) FROM trial "
        "GROUP BY study, method, version ORDER BY study, method, version"
    )
    for study, method, version, count, failed, seconds in found:
        counts = f"{count - failed} answered, {failed} failed"
        yield f"{study} {method}: {counts}, {seconds:.3g} s per trial ({version})"


def _tracebacks(file: sqlite3.Connection) -> Iterator[str]:
    found = file.execute(
        "SELECT study, scenario, seed, method, traceback FROM trial WHERE traceback IS NOT NULL "
        "ORDER BY study, scenario, seed, method"
    )
    for study, scenario, seed, method, traceback in found:
        yield f"\n{study} {scenario} {seed} {method}\n{traceback.rstrip()}"
