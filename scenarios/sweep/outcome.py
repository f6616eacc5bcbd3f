"""A trial's end as it travels and is kept: text, bytes and what it cost."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import Any

from scenarios.sweep.trial import Answer, Failure


@dataclass(frozen=True)
class Outcome:
    """Rows as JSON text and the payload, or a traceback; ``seconds`` the trial took, and ``preparing`` those
    that were spent once for all trials of its drive (wall time)."""

    rows: str = "[]"
    payload: bytes = b""
    traceback: str | None = None
    seconds: float = 0.0
    preparing: float = 0.0

    @classmethod
    def of(cls, answer: Answer, seconds: float, preparing: float) -> Outcome:
        """An answer with its cost. Raises `TypeError` where it is not made of JSON values."""
        rows = json.dumps(list(answer.rows), default=_plain)
        return cls(rows, bytes(answer.payload), None, seconds, preparing)

    def read(self) -> Answer | Failure:
        """What the trial came to."""
        if self.traceback is not None:
            return Failure(self.traceback)
        return Answer(json.loads(self.rows), self.payload)


def _plain(value: Any) -> object:
    """A numpy number as Python's own."""
    try:
        return value.item()
    except (AttributeError, ValueError):
        raise TypeError(
            f"expected JSON values in the rows of an answer, got {type(value).__name__}"
        ) from None
