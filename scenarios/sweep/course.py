"""Which job is next: drives are prepared when a worker has nothing else to do, then their trials are run."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

from scenarios.sweep.attempt import Answering, Prepare, Prepared, attempt, prepared
from scenarios.sweep.outcome import Outcome
from scenarios.sweep.pool import Pool, WorkersDiedError
from scenarios.sweep.trial import Trial
from scenarios.sweep.version import code_version

Numbered = tuple[int, Trial]


@dataclass
class Drive:
    """Trials of one scenario and seed that wait for what they share: `Prepared` or the job that makes it."""

    place: tuple[str, int]
    given: Any = None
    ready: bool = False
    waiting: deque[Numbered] = field(default_factory=deque)


class Course:
    """Jobs that are being done, and trials that wait for them.

    ``trials`` is drawn from only when there is room for a job and nothing that waits is ready, so that what
    a study has learnt by then may decide which trial is next.
    """

    def __init__(
        self, trials: Iterator[Numbered], pool: Pool, answer: Answering, prepare: Prepare | None
    ) -> None:
        self.trials = trials
        self.pool = pool
        self.answer = answer
        self.prepare = prepare
        self.drives: list[Drive] = []
        self.running: dict[Any, Drive | Numbered] = {}
        self.exhausted = False

    def outcomes(self) -> Iterator[tuple[Numbered, Outcome]]:
        """Trials as they end."""
        while self._fill():
            for job in self.pool.ended():
                what = self.running.pop(job)
                if isinstance(what, Drive):
                    self._give(what, job)
                else:
                    yield what, self._outcome(job)

    def _give(self, drive: Drive, job: Any) -> None:
        """Let the trials of a drive begin; where workers died of preparing it, to be told so."""
        try:
            self.pool.check(job)
        except WorkersDiedError as death:
            drive.given = Prepared(traceback=str(death))
        drive.ready = True

    def _outcome(self, job: Any) -> Outcome:
        try:
            return self.pool.result(job)
        except WorkersDiedError as death:
            return Outcome(traceback=str(death))

    def _fill(self) -> bool:
        """Begin jobs while there is room; False when there is nothing left to wait for."""
        while len(self.running) < self.pool.room():
            if not self._begin():
                break
        self.drives = [one for one in self.drives if one.waiting or not one.ready or one is self.drives[-1]]
        return not self.exhausted or bool(self.running) or any(one.waiting for one in self.drives)

    def _begin(self) -> bool:
        """Begin the first job there is; False where there is none."""
        while True:
            for drive in self.drives:
                if drive.ready and drive.waiting:
                    self._run(drive)
                    return True
            if self.drives and self.drives[-1].given is None:
                self._prepare(self.drives[-1])
                return True
            if not self._draw():
                return False

    def _run(self, drive: Drive) -> None:
        number, trial = drive.waiting.popleft()
        job = self.pool.submit(attempt, code_version(), self.answer, trial, drive.given)
        self.running[job] = (number, trial)

    def _prepare(self, drive: Drive) -> None:
        assert self.prepare is not None
        drive.given = self.pool.submit(prepared, code_version(), self.prepare, *drive.place)
        self.running[drive.given] = drive

    def _draw(self) -> bool:
        """Let the next trial wait with those of its drive; False where there is none."""
        drawn = next(self.trials, None)
        if drawn is None:
            self.exhausted = True
            return False
        place = drawn[1].drive
        if not self.drives or self.drives[-1].place != place:
            nothing = Prepared() if self.prepare is None else None
            self.drives.append(Drive(place, nothing, ready=nothing is not None))
        self.drives[-1].waiting.append(drawn)
        return True
