"""What a worker does: prepare a drive, answer a trial; whatever goes wrong in them is their outcome."""

from __future__ import annotations

import time
import traceback
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeAlias

from scenarios.sweep.outcome import Outcome
from scenarios.sweep.trial import Answer, Trial
from scenarios.sweep.version import code_version

Prepare: TypeAlias = Callable[[str, int], Any]
Answering: TypeAlias = Callable[[Trial, Any], Answer]


class OtherCodeError(Exception):
    """A worker runs other code than the sweep; the message is its version."""


@dataclass(frozen=True)
class Prepared:
    """What the trials of a drive share, or the traceback of the attempt to make it; seconds of wall time."""

    material: Any = None
    traceback: str | None = None
    seconds: float = 0.0


def prepared(version: str, prepare: Prepare, scenario: str, seed: int) -> Prepared:
    """What the trials of a drive share. Raises `OtherCodeError` where the worker is of another version."""
    _same_code(version)
    started = time.perf_counter()
    try:
        material = prepare(scenario, seed)
    except Exception as error:  # whatever it was, the other drives go on
        return Prepared(traceback=_told(error), seconds=time.perf_counter() - started)
    return Prepared(material, seconds=time.perf_counter() - started)


def attempt(version: str, answer: Answering, trial: Trial, given: Prepared) -> Outcome:
    """The trial's outcome. Raises `OtherCodeError` where the worker is of another version."""
    _same_code(version)
    if given.traceback is not None:
        return Outcome(traceback=given.traceback, preparing=given.seconds)
    started = time.perf_counter()
    try:
        found = answer(trial, given.material)
        return Outcome.of(found, time.perf_counter() - started, given.seconds)
    except Exception as error:  # whatever it was, the other trials go on
        spent = time.perf_counter() - started
        return Outcome(traceback=_told(error), seconds=spent, preparing=given.seconds)


def _told(error: Exception) -> str:
    """The error in one line, then its traceback."""
    line = " ".join(f"{type(error).__name__}: {error}".split())
    return f"{line}\n{''.join(traceback.format_exception(error))}"


def _same_code(version: str) -> None:
    if code_version() != version:
        raise OtherCodeError(code_version())
