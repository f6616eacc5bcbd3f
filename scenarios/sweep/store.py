"""The file that a sweep's outcomes are kept in: SQLite, one transaction per trial."""

from __future__ import annotations

import contextlib
import json
import sqlite3
from collections.abc import Iterator
from pathlib import Path

from scenarios.sweep.trial import Answer, Failure, Outcome, Trial
from scenarios.sweep.version import code_version
from slam.cli import InputError

APPLICATION = 0x736C616D
"""Marks a file as a sweep's (SQLite's application_id)."""
TABLE = """
CREATE TABLE IF NOT EXISTS trial (
    study TEXT NOT NULL, scenario TEXT NOT NULL, seed INTEGER NOT NULL, method TEXT NOT NULL,
    config_hash TEXT NOT NULL, version TEXT NOT NULL,
    config TEXT NOT NULL, rows TEXT NOT NULL, payload BLOB NOT NULL, traceback TEXT,
    seconds REAL NOT NULL, preparing REAL NOT NULL,
    PRIMARY KEY (study, scenario, seed, method, config_hash, version)
)"""


class Store:
    """Outcomes by trial, of one code version; while it is open, nobody else can write.

    A failed trial is kept for its traceback, but not found again: it is worth another attempt.
    """

    def __init__(self, connection: sqlite3.Connection, path: Path | None) -> None:
        self.connection = connection
        self.path = path

    def find(self, trial: Trial) -> Outcome | None:
        """What an earlier sweep found, None where there is no answer yet."""
        row = self.connection.execute(
            "SELECT rows, payload, seconds, preparing FROM trial WHERE traceback IS NULL AND "
            "study = ? AND scenario = ? AND seed = ? AND method = ? AND config_hash = ? AND version = ?",
            (*trial.key, code_version()),
        ).fetchone()
        if row is None:
            return None
        rows, payload, seconds, preparing = row
        return Outcome(Answer(json.loads(rows), payload), seconds, preparing)

    def keep(self, trial: Trial, outcome: Outcome) -> None:
        """Write an outcome; once this returns, no kill takes it away. Raises `InputError` on a full disk."""
        result, cost = outcome.result, (outcome.seconds, outcome.preparing)
        if isinstance(result, Failure):
            content = "[]", b"", result.traceback
        else:
            content = json.dumps(result.rows), result.payload, None  # type: ignore[assignment]
        row = (*trial.key, code_version(), trial.config_text, *content, *cost)
        marks = ",".join("?" * len(row))
        try:
            with self.connection:
                self.connection.execute(f"INSERT OR REPLACE INTO trial VALUES ({marks})", row)
        except sqlite3.OperationalError as error:
            raise InputError(f"{self.path}: {error}; {self.kept}") from error

    @property
    def kept(self) -> str:
        """What is safe, in words."""
        where = "" if self.path is None else f" in {self.path}; the same command goes on from there"
        query = "SELECT count(*) FROM trial WHERE traceback IS NULL"
        return f"{self.connection.execute(query).fetchone()[0]} answers are kept{where}"

    def is_empty(self) -> bool:
        """Whether no trial is kept, not even a failed one."""
        return self.connection.execute("SELECT 1 FROM trial").fetchone() is None


@contextlib.contextmanager
def opened(path: Path | None, fresh: bool = False) -> Iterator[Store]:
    """The store in a file, made where there is none and emptied where it is to be ``fresh``; None: in memory.

    Raises `InputError` where the file is something else, of other code, in use, or cannot be written. What
    was made here is taken away again when nothing was kept in it.
    """
    made = [] if path is None else [place for place in (path, *path.parents) if not place.exists()]
    try:
        with contextlib.closing(_connected(path, fresh)) as connection:
            store = Store(connection, path)
            try:
                yield store
            finally:
                made = made if store.is_empty() else []
    finally:
        for place in made:
            with contextlib.suppress(OSError):  # a folder that somebody else has put something into stays
                place.rmdir() if place.is_dir() else place.unlink()


def _connected(path: Path | None, fresh: bool) -> sqlite3.Connection:
    """A connection that is the only one, to a table whose outcomes are all of this code."""
    connection = None
    try:
        if path is not None:
            path.parent.mkdir(parents=True, exist_ok=True)
        connection = sqlite3.connect(path or ":memory:", timeout=0.0)
        connection.execute("PRAGMA locking_mode = EXCLUSIVE")  # until it is closed, or its process is gone
        mark = connection.execute("PRAGMA application_id").fetchone()[0]
        tables = connection.execute("SELECT count(*) FROM sqlite_master").fetchone()[0]
        if mark not in (0, APPLICATION) or (mark == 0 and tables > 0):  # before anything is changed in it
            raise InputError(f"{path}: expected a file made by a sweep, found another SQLite file")
        connection.execute(f"PRAGMA application_id = {APPLICATION}")
        connection.execute("PRAGMA journal_mode = WAL")
        connection.execute("PRAGMA synchronous = FULL")
        with connection:
            connection.execute("BEGIN IMMEDIATE")
            connection.execute(TABLE)
            if fresh:
                connection.execute("DELETE FROM trial")
        query, ours = "SELECT version FROM trial WHERE version <> ?", code_version()
        if (other := connection.execute(query, (ours,)).fetchone()) is not None:
            raise InputError(
                f"{path}: made by slamstitch {other[0]}, this is {ours}: "
                "expected another --out, or --fresh to run everything again"
            )
    except (sqlite3.Error, OSError, InputError) as error:
        if connection is not None:
            connection.close()
        if isinstance(error, InputError):
            raise
        raise InputError(f"{path}: {_complaint(error)}") from error
    return connection


def _complaint(error: Exception) -> str:
    """What SQLite found wrong with a file, in the words of whoever sweeps."""
    if "locked" in str(error):
        return "another sweep is writing to it"
    if "not a database" in str(error) or "no such table" in str(error):
        return "expected a file made by a sweep, found something else"
    return str(error)


def contents(path: Path) -> Iterator[str]:
    """Lines for reading: answers, failures and seconds per trial by study and method, then every traceback.

    Raises `InputError` where the file is none of a sweep's.
    """
    if not path.is_file():
        raise InputError(f"{path}: expected the file of a sweep")
    address = f"{path.resolve().as_uri()}?mode=ro"
    try:
        with contextlib.closing(sqlite3.connect(address, uri=True, timeout=0.0)) as file:
            for study, method, version, count, failed, seconds in file.execute(
                "SELECT study, method, version, count(*), sum(traceback IS NOT NULL), avg(seconds) "
                "FROM trial GROUP BY study, method, version ORDER BY study, method, version"
            ):
                counts = f"{count - failed} answered, {failed} failed"
                yield f"{study} {method}: {counts}, {seconds:.3g} s per trial ({version})"
            for *trial, traceback in file.execute(
                "SELECT study, scenario, seed, method, traceback FROM trial WHERE traceback IS NOT NULL "
                "ORDER BY study, scenario, seed, method"
            ):
                yield f"\n{' '.join(map(str, trial))}\n{traceback.rstrip()}"
    except sqlite3.Error as error:
        raise InputError(f"{path}: {_complaint(error)}") from error
