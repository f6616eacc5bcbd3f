"""What came of the trials so far, in their order whoever was first."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

from scenarios.sweep.outcome import Outcome
from scenarios.sweep.trial import Answer, Failure, Trial

Each: TypeAlias = Callable[[Trial, Answer | Failure], None]


class Ledger:
    """Trials by number and their outcomes; ``each`` is told of a trial as soon as all before it are known."""

    def __init__(self, each: Each | None) -> None:
        self.each = each
        self.trials: list[Trial] = []
        self.outcomes: list[Outcome | None] = []
        self.told = 0

    def enter(self, trial: Trial) -> int:
        """Note a trial that is next in the order, and return its number."""
        self.trials.append(trial)
        self.outcomes.append(None)
        return len(self.trials) - 1

    def put(self, number: int, outcome: Outcome) -> None:
        """Note what came of a trial."""
        self.outcomes[number] = outcome
        while self.told < len(self.outcomes) and (known := self.outcomes[self.told]) is not None:
            if self.each is not None:
                self.each(self.trials[self.told], known.read())
            self.told += 1
