"""A submission's row: what became of every recording of the suite, written and read back."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from statistics import fmean, median

from scenarios.evaluation import DEFINITIONS
from scenarios.jsonable import jsonable
from scenarios.suite.version import suite
from slam.cli import InputError

SCHEMA = 1
SCORED, FAILED, UNANSWERED = "scored", "failed", "not answered"
JUDGE = "ate_rmse"
"""The metric that submissions are ranked by."""
MAX_BYTES = 10_000_000


@dataclass(frozen=True)
class Result:
    """What became of one recording: its ``status``, why it failed, its metrics, and the wall time [s] where
    it is stated. ``fingerprint`` tells which recording it was, ``frozen`` whether it is the suite's own."""

    status: str
    reason: str
    metrics: dict[str, float]
    wall_s: float | None
    fingerprint: str
    frozen: bool


@dataclass(frozen=True)
class Row:
    """A submission's results by the name of the recording, and with what they were scored."""

    name: str
    split: str
    results: dict[str, Result]
    machine: str
    code: str
    tolerance: float

    @property
    def failures(self) -> int:
        """How many recordings it has no score for, whatever the reason."""
        return sum(result.status != SCORED for result in self.results.values())

    def values(self, metric: str) -> dict[str, float]:
        """The metric's value by recording, of those that have it."""
        return {n: r.metrics[metric] for n, r in self.results.items() if metric in r.metrics}

    def errors(self, names: Sequence[str]) -> list[float]:
        """The judged error of each recording, infinite where it failed."""
        found = self.values(JUDGE)
        return [found.get(name, math.inf) for name in names]

    def mean(self, metric: str) -> float | None:
        """Mean over the recordings that were scored."""
        found = self.values(metric)
        return fmean(found.values()) if found else None

    def median(self, metric: str) -> float | None:
        """Median over the recordings that were scored."""
        found = self.values(metric)
        return median(found.values()) if found else None

    def worst(self) -> tuple[str, float] | None:
        """The recording with the largest judged error among those scored."""
        return max(self.values(JUDGE).items(), key=lambda pair: pair[1], default=None)

    @property
    def wall_s(self) -> float | None:
        """Wall time [s] of all recordings, None where that of one is not stated."""
        stated = [result.wall_s for result in self.results.values()]
        return None if None in stated else math.fsum(value for value in stated if value is not None)

    def to_json(self) -> str:
        """The row as its file has it."""
        content = {"schema": SCHEMA, "suite": suite().name, **asdict(self)}
        return json.dumps(jsonable(content), indent=1, allow_nan=False) + "\n"


def read_row(path: Path) -> Row:
    """Read a row. Raises `InputError` for a file that is none, or is of another version of the suite."""
    try:
        if path.stat().st_size > MAX_BYTES:
            raise ValueError(f"more than {MAX_BYTES:,} bytes")
        content = json.loads(path.read_text(encoding="utf-8"))
        version = content["schema"], content["suite"]
        results = {
            _known(name): Result(
                _status(entry["status"]),
                str(entry["reason"]),
                {
                    metric: _finite(value)
                    for metric, value in entry["metrics"].items()
                    if metric in DEFINITIONS
                },
                None if entry["wall_s"] is None else _finite(entry["wall_s"]),
                str(entry["fingerprint"]),
                entry["frozen"] is True,
            )
            for name, entry in content["results"].items()
        }
        row = Row(
            str(content["name"]),
            str(content["split"]),
            results,
            str(content["machine"]),
            str(content["code"]),
            _finite(content["tolerance"]),
        )
    except (OSError, ValueError, LookupError, TypeError, AttributeError, RecursionError) as error:
        raise InputError(f"{path}: expected a row that score wrote: {error}") from error
    if version != (SCHEMA, suite().name):
        message = f"row of suite {version[1]!r}, schema {version[0]!r}, expected {suite().name}, {SCHEMA}"
        raise InputError(f"{path}: {message}: versions are not compared")
    return row


def _known(name: str) -> str:
    if name not in {entry.name for entry in suite().entries}:
        raise ValueError(f"no recording of {suite().name}: {name[:40]!r}")
    return name


def _status(word: object) -> str:
    if word not in (SCORED, FAILED, UNANSWERED):
        raise ValueError(f"status {str(word)[:40]!r}")
    return str(word)


def _finite(value: object) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise ValueError(f"{str(value)[:40]!r} is no finite number")
    return float(value)
