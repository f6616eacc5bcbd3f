"""Where jobs are done."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Protocol


class Pool(Protocol):
    """Does jobs; a job among the arguments of another stands for its result."""

    def room(self) -> int:
        """How many jobs are done at a time."""

    def submit(self, work: Callable[..., Any], *arguments: Any) -> Any:
        """Begin a job."""

    def ended(self) -> Sequence[Any]:
        """Jobs that have ended since the last call; waits a while for one."""

    def check(self, job: Any) -> None:
        """Raises `WorkersDiedError` for a job that did not end well."""

    def result(self, job: Any) -> Any:
        """What a job that has ended came to. Raises `WorkersDiedError`."""


class WorkersDiedError(Exception):
    """Worker after worker died of a job; the message says how many."""


class Here:
    """This process, one job after the other."""

    def __init__(self) -> None:
        self.jobs: list[_Done] = []

    def room(self) -> int:
        """One job at a time."""
        return 1

    def submit(self, work: Callable[..., Any], *arguments: Any) -> _Done:
        """Do it now."""
        job = _Done(work(*(one.value if isinstance(one, _Done) else one for one in arguments)))
        self.jobs.append(job)
        return job

    def ended(self) -> Sequence[_Done]:
        """The jobs that were submitted since."""
        jobs, self.jobs = self.jobs, []
        return jobs

    def check(self, job: _Done) -> None:
        """It ended well: this process would have died with it."""

    def result(self, job: _Done) -> Any:
        """What it came to."""
        return job.value


class _Done:
    def __init__(self, value: Any) -> None:
        self.value = value
