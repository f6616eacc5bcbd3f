"""Where jobs are done: in this process, in processes of this machine, or by the workers of a Dask cluster.

`concurrent.futures.ProcessPoolExecutor` gives up every job when one process is killed, and the executor of a
Dask client fetches every result to this machine; these keep the other jobs, and the results where they are.
"""

from __future__ import annotations

import abc
import contextlib
import logging
import multiprocessing
import os
import signal
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import CancelledError, Future, ThreadPoolExecutor
from multiprocessing.connection import Connection
from typing import TYPE_CHECKING, Any
from uuid import uuid4

from scenarios.sweep.attempt import OtherCodeError
from scenarios.sweep.version import code_version
from slam.cli import InputError

if TYPE_CHECKING:
    from distributed import Client

SCHEDULER_TIMEOUT_S = 6.0
"""Seconds that a scheduler has to answer."""
POLL_S = 1.0
"""Seconds after which connection and workers are looked at again."""
MAX_DEATHS = 4
"""Workers that may die of a job before it has failed: as many as Dask allows."""
MAX_START_ATTEMPTS = 20
"""Processes that may die as they start, one after the other, before there is no use in starting more."""
SINGLE_THREAD = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")


class WorkersDiedError(Exception):
    """Worker after worker died of a job; the message says how many."""

    def __init__(self, number: int) -> None:
        super().__init__(f"{number} workers died of it: killed, or out of memory")


class SchedulerLostError(Exception):
    """The connection to the scheduler is lost; the message names it."""


@contextlib.contextmanager
def executor_for(scheduler: str | None, workers: int, say: Callable[[str], None]) -> Iterator[Executor]:
    """The workers of a running ``scheduler``; without one so many processes of this machine, each with one
    thread, 0 for one per core; a single one is this process. ``say`` tells that workers are waited for.

    Raises `InputError` where no scheduler answers.
    """
    if scheduler is not None:
        with _client(scheduler) as client:
            yield DaskExecutor(client, scheduler, say)
    elif workers == 1:
        yield SerialExecutor()
    else:
        with contextlib.closing(ProcessExecutor(workers or _cores())) as executor:
            yield executor


class Executor(abc.ABC):
    """Does jobs, which are futures; one among the arguments of another stands for its result."""

    name = "this machine"

    @abc.abstractmethod
    def capacity(self) -> int:
        """How many jobs are done at a time. Raises `SchedulerLostError`."""

    @abc.abstractmethod
    def submit(self, work: Callable[..., Any], *arguments: Any) -> Any:
        """Begin a job and return its future. Raises `SchedulerLostError`."""

    def require_connection(self) -> None:  # noqa: B027
        """Raises `SchedulerLostError` where there is none any more."""

    def check(self, job: Any) -> None:
        """Raises for a job that did not end well, as `result` does, without fetching its result."""
        with self._translated_errors():
            if (error := job.exception()) is not None:
                raise error

    def result(self, job: Any) -> Any:
        """What a job that has ended came to.

        Raises `WorkersDiedError`, `SchedulerLostError`, and `InputError` where no worker can do a job.
        """
        with self._translated_errors():
            return job.result()

    @contextlib.contextmanager
    def _translated_errors(self) -> Iterator[None]:
        """What went wrong around a job; what a trial raises is never among it, but part of its outcome."""
        try:
            yield
        except (WorkersDiedError, SchedulerLostError, InputError, TimeoutError):
            raise
        except OtherCodeError as error:
            raise InputError(self._other_code(str(error))) from error
        except Exception as error:
            message = f"{type(error).__name__}: {error}"
            raise InputError(f"the workers of {self.name} cannot run trials: {message}") from error

    def _other_code(self, theirs: str) -> str:
        return f"the code was edited while the sweep was at work: it was {code_version()}, now {theirs}"


class SerialExecutor(Executor):
    """This process, one job after the other, each as it is submitted."""

    def capacity(self) -> int:
        """One job at a time."""
        return 1

    def submit(self, work: Callable[..., Any], *arguments: Any) -> Future[Any]:
        """Do it now."""
        job: Future[Any] = Future()
        job.set_result(work(*map(_value, arguments)))
        return job


class ProcessExecutor(Executor):
    """``number`` processes of this machine, a thread for each. One that dies is replaced and its job tried
    again."""

    def __init__(self, number: int) -> None:
        self.number = number
        self.threads = ThreadPoolExecutor(number)
        self.thread = threading.local()
        self.processes: list[multiprocessing.process.BaseProcess] = []
        self.closed = False
        self.lock = threading.Lock()  # nothing is started once it is closed

    def capacity(self) -> int:
        """One job per process."""
        return self.number

    def submit(self, work: Callable[..., Any], *arguments: Any) -> Future[Any]:
        """Let one of the threads have it done."""
        return self.threads.submit(self._run, work, arguments)

    def close(self) -> None:
        """End the processes, whatever they are doing."""
        with self.lock:
            self.closed = True
        for process in self.processes:
            process.kill()
            process.join()
        self.threads.shutdown(cancel_futures=True)

    def _run(self, work: Callable[..., Any], arguments: tuple[Any, ...]) -> Any:
        job = work, tuple(map(_value, arguments))
        for _ in range(MAX_DEATHS):
            connection = self._connection()
            with contextlib.suppress(EOFError, ConnectionError):  # the process has died
                connection.send(job)
                result, error = connection.recv()
                if error is not None:
                    raise error
                return result
            self.thread.connection = None
        raise WorkersDiedError(MAX_DEATHS)

    def _connection(self) -> Connection:
        """To the process of this thread, which is started where there is none."""
        if (connection := getattr(self.thread, "connection", None)) is not None:
            return connection
        context = multiprocessing.get_context("spawn")
        for _ in range(MAX_START_ATTEMPTS):
            ours, theirs = context.Pipe()
            process = context.Process(target=serve, args=(theirs,), daemon=True)
            with self.lock:
                if self.closed:
                    raise CancelledError
                process.start()
                self.processes.append(process)
            theirs.close()
            with contextlib.suppress(EOFError, ConnectionError):  # it died as it started
                ours.recv()
                self.thread.connection = ours
                return ours
            process.join()
        raise InputError(f"workers die as they start, the last with exit code {process.exitcode}")


def serve(connection: Connection) -> None:
    """A worker process: do the jobs that come, with libraries on one thread, until the sweep is gone."""
    os.environ.update(dict.fromkeys(SINGLE_THREAD, "1"))
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the sweep, which ends its workers
    threading.Thread(target=_end_with_parent, daemon=True).start()
    connection.send(None)
    while True:
        try:
            work, arguments = connection.recv()
            connection.send((work(*arguments), None))
        except EOFError:
            return
        except Exception as error:
            connection.send((None, error))


def _end_with_parent() -> None:
    """Leave at once, whatever is being computed, when the sweep's process is gone."""
    parent = multiprocessing.parent_process()
    assert parent is not None
    parent.join()
    os._exit(0)


def _value(argument: Any) -> Any:
    return argument.result() if isinstance(argument, Future) else argument


def _cores() -> int:
    from dask.system import CPU_COUNT  # what a container may use of them

    return CPU_COUNT


@contextlib.contextmanager
def _client(scheduler: str) -> Iterator[Client]:
    import asyncio

    from distributed import Client

    for name in list(
        logging.root.manager.loggerDict
    ):  # outcomes tell what happens to workers, not pages of log
        if name.split(".")[0] in ("distributed", "tornado", "asyncio"):
            logging.getLogger(name).setLevel(logging.CRITICAL + 1)
    try:
        asyncio.run(asyncio.wait_for(_connect(scheduler), SCHEDULER_TIMEOUT_S))
        client = Client(scheduler, timeout=SCHEDULER_TIMEOUT_S, set_as_default=False)
    except Exception as error:  # whoever listens there may answer anything
        expected = f"expected a Dask scheduler, none answered within {SCHEDULER_TIMEOUT_S:.0f} s"
        raise InputError(f"--scheduler {scheduler}: {expected}") from error
    with client:
        yield client


async def _connect(scheduler: str) -> None:
    """See whether a Dask server answers: a client would wait for a mute one for ever."""
    from distributed.comm import connect
    from distributed.security import Security

    timeout = SCHEDULER_TIMEOUT_S
    comm = await connect(scheduler, timeout=timeout, **Security().get_connection_args("client"))
    await comm.close()


class DaskExecutor(Executor):
    """The workers of a Dask cluster; results stay with them until they are asked for."""

    def __init__(self, client: Client, name: str, say: Callable[[str], None]) -> None:
        self.client = client
        self.name = name
        self.say = say
        self.counted = (-POLL_S, -1)

    def capacity(self) -> int:
        """Threads of all workers that there are just now."""
        when, threads = self.counted
        if time.monotonic() - when >= POLL_S:
            with self._translated_errors():
                threads = sum(self.client.nthreads().values())
            if threads == 0 != self.counted[1]:
                self.say(f"{self.name} has no workers: waiting for some")
            self.counted = (time.monotonic(), threads)
        return threads

    def submit(self, work: Callable[..., Any], *arguments: Any) -> Any:
        """Begin a job on a worker that is free."""
        with self._translated_errors():
            return self.client.submit(work, *arguments, key=f"{work.__name__}-{uuid4().hex}", pure=False)

    def require_connection(self) -> None:
        if self.client.status != "running":
            raise SchedulerLostError(f"{self.name} is gone")

    def result(self, job: Any) -> Any:
        """What it came to; where its worker died before it was fetched, once it is done again."""
        timeout = POLL_S
        while True:
            try:
                with self._translated_errors():
                    return job.result(timeout=timeout)
            except TimeoutError:
                self.require_connection()
                timeout *= 2.0

    @contextlib.contextmanager
    def _translated_errors(self) -> Iterator[None]:
        from distributed import KilledWorker

        with super()._translated_errors():
            try:
                yield
            except TimeoutError:
                raise
            except KilledWorker as error:
                raise WorkersDiedError(error.allowed_failures + 1) from error
            except (OSError, CancelledError) as error:
                raise SchedulerLostError(f"{self.name} is gone") from error

    def _other_code(self, theirs: str) -> str:
        ours = f"this is {code_version()}: expected the same on all machines"
        return f"a worker of {self.name} runs slamstitch {theirs}, {ours}"
