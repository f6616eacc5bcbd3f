"""Which job is next: drives are prepared when a worker has nothing else to do, then their trials are run."""

from __future__ import annotations

import contextlib
import queue
from collections.abc import Iterator
from typing import Any

from scenarios.sweep import executors
from scenarios.sweep.executors import DaskExecutor, SerialExecutor, WorkersDiedError
from scenarios.sweep.trial import (
    Failure,
    Outcome,
    Prepare,
    Prepared,
    RunTrial,
    Trial,
    attempt_trial,
    prepare_drive,
)
from scenarios.sweep.version import code_version

Numbered = tuple[int, Trial]


class TrialScheduler:
    """Jobs that are being done, and trials that wait for the preparation of their drive.

    ``trials`` is drawn from only when there is room for a job and nothing that waits is ready, so that what
    a study has learnt by then may decide which trial is next. Dask cannot tell of which of its jobs a worker
    died: a trial that is suspected is tried once more with nothing beside it.
    """

    def __init__(
        self,
        trials: Iterator[Numbered],
        executor: SerialExecutor | DaskExecutor,
        run_trial: RunTrial,
        prepare: Prepare | None,
    ) -> None:
        self.trials = trials
        self.executor = executor
        self.run_trial = run_trial
        self.prepare = prepare
        self.drive: tuple[str, int] | None = None
        self.prepared: Any = Prepared()
        self.waiting: list[tuple[Numbered, Any]] = []
        self.running: dict[Any, Numbered | None] = {}
        self.suspects: list[tuple[Any, Numbered]] = []
        self.alone: Any = None
        self.ended: queue.SimpleQueue[Any] = queue.SimpleQueue()
        self.exhausted = False

    def outcomes(self) -> Iterator[tuple[Numbered, Outcome]]:
        """Trials as they end. Raises as the executor's ``result`` does, but for `WorkersDiedError`."""
        while self._fill():
            for job in self._ended_jobs():
                trial = self.running.pop(job)
                if trial is None:  # the preparation of a drive
                    continue
                try:
                    outcome = self.executor.result(job)
                except WorkersDiedError as death:
                    if job is not self.alone:
                        self.suspects.append((job, trial))
                        continue
                    outcome = Outcome(Failure(str(death)))
                yield trial, outcome

    def _ended_jobs(self) -> list[Any]:
        """Jobs that have ended since the last call; waits a while for one."""
        jobs = []
        with contextlib.suppress(queue.Empty):
            jobs.append(self.ended.get(timeout=executors.POLL_S))
            while True:
                jobs.append(self.ended.get_nowait())
        return jobs

    def _fill(self) -> bool:
        """Begin jobs while there is room; False when there is nothing left to wait for."""
        if self.suspects and not self.running:
            self.alone, trial = self.suspects.pop()
            self.alone.retry()
            self._watch(self.alone, trial)
        while len(self.running) < self.executor.capacity():
            if self.suspects or self.alone in self.running or not self._begin():
                break
        return bool(self.running or self.waiting or self.suspects) or not self.exhausted

    def _begin(self) -> bool:
        """Begin the first job there is, or let the next trial wait; False where there is none."""
        for k, (numbered, prepared) in enumerate(self.waiting):
            if isinstance(prepared, Prepared) or prepared.done():
                del self.waiting[k]
                self._submit(numbered, attempt_trial, self.run_trial, numbered[1], prepared)
                return True
        drawn = next(self.trials, None)
        if drawn is None:
            self.exhausted = True
            return False
        if self.prepare is not None and self.drive != drawn[1].drive:
            self.drive = drawn[1].drive
            self.prepared = self._submit(None, prepare_drive, self.prepare, *self.drive)
        self.waiting.append((drawn, self.prepared))
        return True

    def _submit(self, trial: Numbered | None, work: Any, *arguments: Any) -> Any:
        job = self.executor.submit(work, code_version(), *arguments)
        self._watch(job, trial)
        return job

    def _watch(self, job: Any, trial: Numbered | None) -> None:
        self.running[job] = trial
        job.add_done_callback(self.ended.put)
