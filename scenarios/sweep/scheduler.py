"""Which job is next: drives are prepared when a worker has nothing else to do, then their trials are run."""

from __future__ import annotations

import contextlib
import queue
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

from scenarios.sweep import executors
from scenarios.sweep.attempt import Prepare, Prepared, RunTrial, attempt_trial, prepare_drive
from scenarios.sweep.executors import Executor, WorkersDiedError
from scenarios.sweep.trial import Failure, Outcome, Trial
from scenarios.sweep.version import code_version

Numbered = tuple[int, Trial]


@dataclass
class PendingDrive:
    """Trials of one scenario and seed that wait for what they share: `Prepared` or the job that makes it."""

    key: tuple[str, int]
    prepared: Any = None
    ready: bool = False
    waiting: deque[Numbered] = field(default_factory=deque)


class TrialScheduler:
    """Jobs that are being done, and trials that wait for them.

    ``trials`` is drawn from only when there is room for a job and nothing that waits is ready, so that what
    a study has learnt by then may decide which trial is next.
    """

    def __init__(
        self, trials: Iterator[Numbered], executor: Executor, run_trial: RunTrial, prepare: Prepare | None
    ) -> None:
        self.trials = trials
        self.executor = executor
        self.run_trial = run_trial
        self.prepare = prepare
        self.drives: list[PendingDrive] = []
        self.running: dict[Any, PendingDrive | Numbered] = {}
        self.ended: queue.SimpleQueue[Any] = queue.SimpleQueue()
        self.exhausted = False

    def outcomes(self) -> Iterator[tuple[Numbered, Outcome]]:
        """Trials as they end. Raises as `Executor.result` does, but for `WorkersDiedError`."""
        while self._fill():
            for job in self._ended_jobs():
                item = self.running.pop(job)
                if isinstance(item, PendingDrive):
                    self._release(item, job)
                else:
                    yield item, self._outcome(job)

    def _ended_jobs(self) -> list[Any]:
        """Jobs that have ended since the last call; waits a while for one."""
        jobs = []
        with contextlib.suppress(queue.Empty):
            jobs.append(self.ended.get(timeout=executors.POLL_S))
            while True:
                jobs.append(self.ended.get_nowait())
        self.executor.require_connection()
        return jobs

    def _release(self, drive: PendingDrive, job: Any) -> None:
        """Let the trials of a drive begin; where workers died of preparing it, they fail of that."""
        try:
            self.executor.check(job)
        except WorkersDiedError as death:
            drive.prepared = Prepared(failure=Failure(str(death)))
        drive.ready = True

    def _outcome(self, job: Any) -> Outcome:
        try:
            return self.executor.result(job)
        except WorkersDiedError as death:
            return Outcome(Failure(str(death)))

    def _fill(self) -> bool:
        """Begin jobs while there is room; False when there is nothing left to wait for."""
        while len(self.running) < self.executor.capacity():
            if not self._begin():
                break
        last = self.drives[-1:]
        self.drives = [drive for drive in self.drives if drive.waiting or not drive.ready or drive in last]
        return not self.exhausted or bool(self.running) or any(drive.waiting for drive in self.drives)

    def _begin(self) -> bool:
        """Begin the first job there is; False where there is none."""
        while True:
            for drive in self.drives:
                if drive.ready and drive.waiting:
                    number, trial = drive.waiting.popleft()
                    self._submit((number, trial), attempt_trial, self.run_trial, trial, drive.prepared)
                    return True
            if self.drives and self.drives[-1].prepared is None:
                drive = self.drives[-1]
                drive.prepared = self._submit(drive, prepare_drive, self.prepare, *drive.key)
                return True
            if not self._draw():
                return False

    def _submit(self, item: PendingDrive | Numbered, work: Any, *arguments: Any) -> Any:
        job = self.executor.submit(work, code_version(), *arguments)
        self.running[job] = item
        job.add_done_callback(self.ended.put)
        return job

    def _draw(self) -> bool:
        """Let the next trial wait with those of its drive; False where there is none."""
        drawn = next(self.trials, None)
        if drawn is None:
            self.exhausted = True
            return False
        key = drawn[1].drive
        if not self.drives or self.drives[-1].key != key:
            prepared = Prepared() if self.prepare is None else None
            self.drives.append(PendingDrive(key, prepared, ready=prepared is not None))
        self.drives[-1].waiting.append(drawn)
        return True
