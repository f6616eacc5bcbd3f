"""What a sweep runs, how a worker does it, and what comes of it."""

from __future__ import annotations

import hashlib
import json
import time
import traceback
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, TypeAlias

from scenarios.sweep.version import code_version


@dataclass(frozen=True)
class Trial:
    """One method on one drive of a scenario, for one study.

    ``config`` holds everything else that the answer depends on, but for the code, as JSON values.
    """

    study: str
    scenario: str
    seed: int
    method: str
    config: Mapping[str, Any] = field(default_factory=dict, hash=False)

    @property
    def drive(self) -> tuple[str, int]:
        """What trials share that can share a preparation: scenario and seed."""
        return self.scenario, self.seed

    @property
    def config_text(self) -> str:
        """The configuration as JSON, the same for equal ones. Raises `TypeError` where it is not JSON."""
        return json.dumps(self.config, sort_keys=True, separators=(",", ":"))

    @property
    def key(self) -> tuple[str, str, int, str, str]:
        """What tells a trial from all others of the same code, the configuration by its hash."""
        config_hash = hashlib.sha256(self.config_text.encode()).hexdigest()[:16]
        return self.study, self.scenario, self.seed, self.method, config_hash

    @property
    def name(self) -> str:
        """The trial, as messages call it."""
        return f"{self.scenario} {self.seed} {self.method}"


@dataclass(frozen=True)
class Answer:
    """What a trial found: rows of JSON values (floats survive exactly, NaN and infinities too), and bytes for
    what is too large for them, say an ``.npz``."""

    rows: Sequence[Mapping[str, Any]]
    payload: bytes = b""


@dataclass(frozen=True)
class Failure:
    """Why a trial has no answer: a line, then the traceback."""

    traceback: str

    @property
    def line(self) -> str:
        """The error in one line."""
        return self.traceback.splitlines()[0]


@dataclass(frozen=True)
class Outcome:
    """How a trial ended, with its cost: ``seconds`` it took, and ``preparing`` those that were spent once for
    all trials of its drive (wall time)."""

    result: Answer | Failure
    seconds: float = 0.0
    preparing: float = 0.0

    @property
    def failed(self) -> bool:
        """Whether the trial has no answer."""
        return isinstance(self.result, Failure)


Prepare: TypeAlias = Callable[[str, int], Any]
RunTrial: TypeAlias = Callable[[Trial, Any], Answer]


class OtherCodeError(Exception):
    """A worker runs other code than the sweep; the message is its version."""


@dataclass(frozen=True)
class Prepared:
    """What the trials of a drive share, or why it could not be made; seconds of wall time."""

    material: Any = None
    failure: Failure | None = None
    seconds: float = 0.0


def prepare_drive(version: str, prepare: Prepare, scenario: str, seed: int) -> Prepared:
    """What the trials of a drive share. Raises `OtherCodeError` where the worker is of another version."""
    _require_version(version)
    started = time.perf_counter()
    try:
        material, failure = prepare(scenario, seed), None
    except Exception as error:  # whatever it was, the other drives go on
        material, failure = None, _failure(error)
    return Prepared(material, failure, time.perf_counter() - started)


def attempt_trial(version: str, run_trial: RunTrial, trial: Trial, prepared: Prepared) -> Outcome:
    """The trial's outcome. Raises `OtherCodeError` where the worker is of another version."""
    _require_version(version)
    if prepared.failure is not None:
        return Outcome(prepared.failure, preparing=prepared.seconds)
    started = time.perf_counter()
    result: Answer | Failure
    try:
        answer = run_trial(trial, prepared.material)
        rows = json.loads(json.dumps(list(answer.rows), default=_python_number))  # as the store has them
        result = Answer(rows, bytes(answer.payload))
    except Exception as error:  # whatever it was, the other trials go on
        result = _failure(error)
    return Outcome(result, time.perf_counter() - started, prepared.seconds)


def _python_number(value: Any) -> object:
    """A numpy number as Python's own. Raises `TypeError` for anything else."""
    try:
        return value.item()
    except (AttributeError, ValueError):
        raise TypeError(
            f"expected JSON values in the rows of an answer, got {type(value).__name__}"
        ) from None


def _failure(error: Exception) -> Failure:
    """The error in one line, then its traceback."""
    line = " ".join(f"{type(error).__name__}: {error}".split())
    return Failure(f"{line}\n{''.join(traceback.format_exception(error))}")


def _require_version(version: str) -> None:
    if code_version() != version:
        raise OtherCodeError(code_version())
