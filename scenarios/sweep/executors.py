"""Where jobs are done: in this process, or by Dask workers, of this machine or of a cluster."""

from __future__ import annotations

import contextlib
import logging
import signal
import time
from collections.abc import Callable, Iterator
from concurrent.futures import CancelledError, Future
from typing import TYPE_CHECKING, Any
from uuid import uuid4

from scenarios.sweep.trial import OtherCodeError
from scenarios.sweep.version import code_version
from slam.cli import InputError

if TYPE_CHECKING:
    from distributed import Client, LocalCluster

SCHEDULER_TIMEOUT_S = 6.0
"""Seconds that a scheduler has to answer."""
REPLACED_S = 10.0
"""Seconds within which a worker that died is replaced."""
POLL_S = 1.0
"""Seconds after which connection and workers are looked at again."""
PRELOAD = __name__
"""Module whose `dask_setup` prepares every worker of this machine."""


class WorkersDiedError(Exception):
    """Worker after worker died of a job; the message says how many."""


class SchedulerLostError(Exception):
    """The connection to the scheduler is lost; the message names it."""


@contextlib.contextmanager
def executor_for(scheduler: str | None, workers: int, say: Callable[[str], None]) -> Iterator[Any]:
    """The workers of a running ``scheduler``; without one so many processes of this machine, each with one
    thread, 0 for one per core; a single one is this process. ``say`` tells that workers are waited for.

    Raises `InputError` where no scheduler answers, or where workers die as they start.
    """
    if scheduler is None and workers == 1:
        yield SerialExecutor()
        return
    _silence()
    if scheduler is None:
        with _local_client(workers) as client:
            yield DaskExecutor(client, "this machine", lambda words: None)
    else:
        with _connected(scheduler) as client:
            yield DaskExecutor(client, scheduler, say)


@contextlib.contextmanager
def _local_client(workers: int) -> Iterator[Client]:
    """A client of worker processes of this machine, which end with it.

    Dask fails to close while it replaces a worker that died, so those that are on their way are waited for;
    one that never comes is no matter: all that was asked for is known by then, or an error is on its way up.
    """
    cluster = _local_cluster(workers)
    try:
        with cluster.get_client() as client:
            try:
                yield client
            finally:
                with contextlib.suppress(TimeoutError):
                    client.wait_for_workers(max(1, len(cluster.workers)), timeout=REPLACED_S)
    finally:
        with contextlib.suppress(AssertionError):
            cluster.close()


def _local_cluster(workers: int) -> LocalCluster:
    """Worker processes with one thread each; one that dies is replaced, all end with this process."""
    from distributed import LocalCluster

    try:
        return LocalCluster(
            n_workers=workers or None,
            threads_per_worker=1,
            memory_limit=0,
            dashboard_address="127.0.0.1:0",
            scheduler_kwargs={"dashboard": False},
            silence_logs=logging.CRITICAL + 1,
            env={"NUMBA_NUM_THREADS": "1"},  # Dask says the same to OpenMP, OpenBLAS and MKL
            preload=PRELOAD,
        )
    except RuntimeError as error:
        raise InputError(f"workers die as they start: {error.__cause__ or error}") from error


def _connected(scheduler: str) -> Client:
    """A client of a running scheduler. Raises `InputError` where none answers."""
    import asyncio

    from distributed import Client
    from distributed.comm import connect
    from distributed.security import Security

    async def answer() -> None:
        """A client would wait for a mute server for ever."""
        security = Security().get_connection_args("client")
        comm = await connect(scheduler, timeout=SCHEDULER_TIMEOUT_S, **security)
        await comm.close()

    try:
        asyncio.run(asyncio.wait_for(answer(), SCHEDULER_TIMEOUT_S))
        return Client(scheduler, timeout=SCHEDULER_TIMEOUT_S, set_as_default=False)
    except Exception as error:  # whoever listens there may answer anything
        expected = f"expected a Dask scheduler, none answered within {SCHEDULER_TIMEOUT_S:.0f} s"
        raise InputError(f"--scheduler {scheduler}: {expected}") from error


def dask_setup(worker: object) -> None:
    """Called in every worker of this machine: Ctrl-C is for the sweep, which ends its workers."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def _silence() -> None:
    """Outcomes tell what happens to workers, not pages of log."""
    for name in list(logging.root.manager.loggerDict):
        if name.split(".")[0] in ("distributed", "tornado", "asyncio"):
            logging.getLogger(name).setLevel(logging.CRITICAL + 1)


class SerialExecutor:
    """This process, one job after the other, each as it is submitted; a job is a future, as with Dask."""

    def capacity(self) -> int:
        """One job at a time."""
        return 1

    def submit(self, work: Callable[..., Any], *arguments: Any) -> Future[Any]:
        """Do it now; a future among the arguments stands for its result."""
        job: Future[Any] = Future()
        job.set_result(work(*(a.result() if isinstance(a, Future) else a for a in arguments)))
        return job

    def result(self, job: Future[Any]) -> Any:
        """What a job came to."""
        return job.result()


class DaskExecutor:
    """Dask workers; results stay with them until they are asked for."""

    def __init__(self, client: Client, name: str, say: Callable[[str], None]) -> None:
        self.client = client
        self.name = name
        self.say = say
        self.counted = (-POLL_S, -1)

    def capacity(self) -> int:
        """Threads of all workers that there are just now. Raises `SchedulerLostError`."""
        if self.client.status != "running":
            raise SchedulerLostError(f"{self.name} is gone")
        when, threads = self.counted
        if time.monotonic() - when >= POLL_S:
            with self._translated_errors():
                threads = sum(self.client.nthreads().values())
            if threads == 0 != self.counted[1]:
                self.say(f"{self.name} has no workers: waiting for some")
            self.counted = (time.monotonic(), threads)
        return threads

    def submit(self, work: Callable[..., Any], *arguments: Any) -> Any:
        """Begin a job and return its future; one among the arguments stands for its result.

        Raises `SchedulerLostError`.
        """
        with self._translated_errors():
            return self.client.submit(work, *arguments, key=f"{work.__name__}-{uuid4().hex}", pure=False)

    def result(self, job: Any) -> Any:
        """What a job that has ended came to; where its worker died before that was fetched, once it is done
        again.

        Raises `WorkersDiedError`, `SchedulerLostError`, and `InputError` where no worker can do a job.
        """
        timeout = POLL_S
        while True:
            try:
                with self._translated_errors():
                    return job.result(timeout=timeout)
            except TimeoutError:
                self.capacity()
                timeout *= 2.0

    @contextlib.contextmanager
    def _translated_errors(self) -> Iterator[None]:
        """What went wrong around a job; what a trial raises is never among it, but part of its outcome."""
        from distributed import KilledWorker

        try:
            yield
        except TimeoutError:
            raise
        except KilledWorker as error:
            number = error.allowed_failures + 1
            raise WorkersDiedError(f"{number} workers died of it: killed, or out of memory") from error
        except (OSError, CancelledError) as error:
            raise SchedulerLostError(f"{self.name} is gone") from error
        except OtherCodeError as error:
            ours = f"this is {code_version()}: expected the same everywhere, and no edit during a sweep"
            raise InputError(f"a worker of {self.name} runs slamstitch {error}, {ours}") from error
        except Exception as error:
            message = f"{type(error).__name__}: {error}"
            raise InputError(f"the workers of {self.name} cannot run trials: {message}") from error
