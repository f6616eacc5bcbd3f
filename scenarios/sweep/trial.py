"""What a sweep runs, and what comes of it."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any


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
