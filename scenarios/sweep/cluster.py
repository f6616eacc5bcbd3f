"""The workers of a Dask cluster: processes of this machine, or those of a scheduler that runs already."""

from __future__ import annotations

import contextlib
import logging
import queue
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import CancelledError
from typing import TYPE_CHECKING, Any
from uuid import uuid4

from scenarios.sweep.attempt import OtherCodeError
from scenarios.sweep.pool import Here, Pool, WorkersDiedError
from scenarios.sweep.processes import Processes
from scenarios.sweep.version import code_version
from slam.cli import InputError

if TYPE_CHECKING:
    from distributed import Client, Future

PATIENCE = 6.0
"""Seconds that a scheduler has to answer."""
RECOUNT = 1.0
"""Seconds after which the workers are counted again."""


class SchedulerLostError(Exception):
    """The connection to the scheduler is lost; the message names it."""


@contextlib.contextmanager
def pool(scheduler: str | None, workers: int, say: Callable[[str], None]) -> Iterator[Pool]:
    """The workers of a running ``scheduler``; without one so many processes of this machine, each with one
    thread, 0 for one per core; a single one is this process. Whoever waits for workers is told by ``say``.

    Raises `InputError` where no scheduler answers, or its workers run other code.
    """
    if scheduler is None and workers == 1:
        yield Here()
        return
    _silence()
    if scheduler is not None:
        with _existing(scheduler) as client:
            yield Cluster(client, scheduler, say)
        return
    with _alone() as (client, address), Processes(address, workers or _cores()) as processes:
        yield Cluster(client, "the cluster of this machine", say, processes)


@contextlib.contextmanager
def _alone() -> Iterator[tuple[Client, str]]:
    """A client of a scheduler in this process, which knows no workers yet, and the scheduler's address."""
    import dask
    from distributed import Client, LocalCluster

    quiet = logging.CRITICAL
    with (
        dask.config.set({"distributed.scheduler.worker-saturation": 1.0}),
        LocalCluster(n_workers=0, dashboard_address=":0", host="127.0.0.1", silence_logs=quiet) as cluster,
        Client(cluster, set_as_default=False) as client,
    ):
        yield client, cluster.scheduler_address


def _cores() -> int:
    from dask.system import CPU_COUNT

    return CPU_COUNT


@contextlib.contextmanager
def _existing(scheduler: str) -> Iterator[Client]:
    import asyncio

    from distributed import Client

    try:
        asyncio.run(asyncio.wait_for(_knock(scheduler), PATIENCE))
        client = Client(scheduler, timeout=PATIENCE, set_as_default=False)
    except Exception as error:  # whoever listens there may answer anything
        said = f"expected a Dask scheduler, none answered within {PATIENCE:.0f} s"
        raise InputError(f"--scheduler {scheduler}: {said}") from error
    with client:
        yield client


async def _knock(scheduler: str) -> None:
    """See whether a Dask server answers: a client would wait for a mute one for ever."""
    from distributed.comm import connect
    from distributed.security import Security

    comm = await connect(scheduler, timeout=PATIENCE, **Security().get_connection_args("client"))
    await comm.close()


def _silence() -> None:
    """What happens to workers is told by the outcome of trials, not by pages of log."""
    import distributed  # noqa: F401  (sets its loggers up)

    for name in list(logging.root.manager.loggerDict):
        if name.split(".")[0] in ("distributed", "tornado", "asyncio"):
            logging.getLogger(name).setLevel(logging.CRITICAL + 1)


class Cluster:
    """Workers reached through a Dask client; ``processes`` are ours to look after, if they are."""

    def __init__(
        self, client: Client, name: str, say: Callable[[str], None], processes: Processes | None = None
    ) -> None:
        self.client = client
        self.name = name
        self.say = say
        self.processes = processes
        self.queue: queue.SimpleQueue[Future] = queue.SimpleQueue()
        self.counted = (-RECOUNT, -1)

    def room(self) -> int:
        """Threads of all workers that there are just now. Raises `SchedulerLostError`."""
        when, room = self.counted
        if time.monotonic() - when >= RECOUNT:
            with self._telling():
                room = sum(self.client.nthreads().values())
            if room == 0 != self.counted[1] and self.processes is None:
                self.say(f"{self.name} has no workers: waiting for some")
            self.counted = (time.monotonic(), room)
        return room

    def submit(self, work: Callable[..., Any], *arguments: Any) -> Future:
        """Begin a job on a worker that is free. Raises `SchedulerLostError`."""
        with self._telling():
            future = self.client.submit(work, *arguments, key=f"{work.__name__}-{uuid4().hex}", pure=False)
        future.add_done_callback(self.queue.put)
        return future

    def ended(self) -> Sequence[Future]:
        """Jobs that have ended. Raises `SchedulerLostError`."""
        found = []
        with contextlib.suppress(queue.Empty):
            found.append(self.queue.get(timeout=RECOUNT))
            while True:
                found.append(self.queue.get_nowait())
        self._look_after(useful=bool(found))
        return found

    def check(self, job: Future) -> None:
        """Raises `WorkersDiedError`, `SchedulerLostError`, and `InputError` where no worker can do a job."""
        with self._telling():
            if (error := job.exception()) is not None:
                raise error

    def result(self, job: Future) -> Any:
        """What it came to; where its worker died before it was fetched, once it is done again.

        Raises as `check` does.
        """
        patience = RECOUNT
        while True:
            try:
                with self._telling():
                    return job.result(timeout=patience)
            except TimeoutError:
                self._look_after(useful=False)
                patience *= 2.0

    def _look_after(self, useful: bool) -> None:
        if self.client.status != "running":
            raise SchedulerLostError(f"{self.name} is gone")
        if self.processes is not None:
            self.processes.tend(useful)

    @contextlib.contextmanager
    def _telling(self) -> Iterator[None]:
        """Dask's complaints in words; what a trial raises is never among them, but part of its outcome."""
        from distributed import KilledWorker

        try:
            yield
        except TimeoutError:
            raise
        except OtherCodeError as error:
            raise InputError(self._differs(str(error))) from error
        except KilledWorker as error:
            died = f"{error.allowed_failures + 1} workers died of it: killed, or out of memory"
            raise WorkersDiedError(died) from error
        except (OSError, CancelledError) as error:
            raise SchedulerLostError(f"{self.name} is gone") from error
        except Exception as error:
            said = f"{type(error).__name__}: {error}"
            raise InputError(f"the workers of {self.name} cannot run trials: {said}") from error

    def _differs(self, theirs: str) -> str:
        if self.processes is not None:
            return f"the code was edited while the sweep was at work: it was {code_version()}, now {theirs}"
        ours = f"this is {code_version()}: expected the same on all machines"
        return f"a worker of {self.name} runs slamstitch {theirs}, {ours}"
