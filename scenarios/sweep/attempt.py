"""What a worker does: prepare a drive, run a trial; whatever goes wrong in them is their outcome."""

from __future__ import annotations

import json
import time
import traceback
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeAlias

from scenarios.sweep.trial import Answer, Failure, Outcome, Trial
from scenarios.sweep.version import code_version

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
