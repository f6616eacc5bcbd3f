"""A process that damages files and reads them, within bounds of time and memory."""

from __future__ import annotations

import multiprocessing
import os
import shutil
import tempfile
import time
import traceback
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait
from multiprocessing.context import SpawnContext
from pathlib import Path

import numpy as np

from scenarios.bench.fuzzing.mutations import MUTATIONS
from scenarios.bench.fuzzing.samples import Sample, samples

Make = Callable[[Path], dict[str, Sample]]
SECONDS = 10.0
"""Reading a file may take so long."""
BYTES = 2_000_000_000
"""Reading a file may take so much memory, beside what the process had before."""
START_SECONDS = 120.0
"""Starting a process may take so long."""
READ, REFUSED = "read", "refused"
TRACEBACK, HANG, MEMORY, CRASH = "traceback", "hang", "memory", "crash"
OUTCOMES = (READ, REFUSED, TRACEBACK, HANG, MEMORY, CRASH)


@dataclass(frozen=True)
class Outcome:
    """What reading the damaged file of an ``index`` did; ``detail`` says where it failed."""

    index: int
    kind: str
    mutation: str
    outcome: str
    detail: str = ""

    @property
    def failed(self) -> bool:
        """Whether it was neither read nor refused in one line."""
        return self.outcome not in (READ, REFUSED)


def damaged(made: dict[str, Sample], seed: int, index: int) -> tuple[str, str, dict[str, bytes]]:
    """Kind, mutation and files of an index: drawn from the seed and the index alone."""
    rng = np.random.default_rng([seed, index])
    kind = list(made)[index % len(made)]
    mutation = list(MUTATIONS)[rng.integers(len(MUTATIONS))]
    files = dict(made[kind].files)
    name = list(files)[rng.integers(len(files))]
    files[name] = MUTATIONS[mutation](files[name], rng)
    return kind, mutation, files


def write(folder: Path, files: dict[str, bytes]) -> None:
    """Write files into a new folder."""
    folder.mkdir(parents=True)
    for name, content in files.items():
        (folder / name).write_bytes(content)


def outcomes(seed: int, files: int, workers: int, make: Make = samples) -> Iterator[Outcome]:
    """What became of damaged files 0 … ``files``, in the order in which they are done.

    ``make`` writes good files into a folder, and answers them by kind.
    """
    context = multiprocessing.get_context("spawn")
    running: dict[Connection, _Share] = {}
    for k in range(workers):
        _start(context, _Share(make, seed, k, files, workers), running)
    try:
        while running:
            ready = wait(list(running), timeout=0.5)
            for connection in ready:
                assert isinstance(connection, Connection)
                yield from _heard(context, connection, running)
            for connection, share in list(running.items()):
                if time.monotonic() > share.deadline:
                    yield from _lost(context, connection, running, HANG)
    finally:
        for connection, share in running.items():
            share.process.kill()
            share.process.join()
            connection.close()


@dataclass
class _Share:
    """The files ``next``, ``next + step``, … of one process."""

    make: Make
    seed: int
    next: int
    stop: int
    step: int
    process: multiprocessing.process.BaseProcess = None  # type: ignore[assignment]  # set when it starts
    kind: str = ""
    mutation: str = ""
    deadline: float = 0.0


def _start(context: SpawnContext, share: _Share, running: dict[Connection, _Share]) -> None:
    if share.next >= share.stop:
        return
    ours, theirs = context.Pipe()
    arguments = (theirs, share.make, share.seed, range(share.next, share.stop, share.step))
    share.process = context.Process(target=_work, args=arguments, daemon=True)
    share.process.start()
    theirs.close()
    share.kind, share.deadline = "", time.monotonic() + START_SECONDS
    running[ours] = share


def _heard(
    context: SpawnContext, connection: Connection, running: dict[Connection, _Share]
) -> Iterator[Outcome]:
    share = running[connection]
    try:
        message = connection.recv()
    except EOFError:
        yield from _lost(context, connection, running, CRASH)
        return
    if isinstance(message, Outcome):
        share.next = message.index + share.step
        share.kind = ""
        yield message
    else:
        share.kind, share.mutation = message
    share.deadline = time.monotonic() + SECONDS


def _lost(
    context: SpawnContext,
    connection: Connection,
    running: dict[Connection, _Share],
    outcome: str,
) -> Iterator[Outcome]:
    """The process is gone, or must go: its file failed, another process goes on behind it."""
    share = running.pop(connection)
    connection.close()
    share.process.kill()
    share.process.join()
    if share.next >= share.stop:
        return
    if not share.kind:
        raise RuntimeError(f"a process of the fuzz bench ended before its file {share.next}")
    yield Outcome(share.next, share.kind, share.mutation, outcome, f"exit code {share.process.exitcode}")
    share.next += share.step
    _start(context, share, running)


def _work(connection: Connection, make: Make, seed: int, indices: range) -> None:
    """Read one damaged file after the other, and send what is being read and what became of it."""
    warnings.simplefilter("ignore")
    with tempfile.TemporaryDirectory(prefix="fuzz-") as folder:
        (Path(folder) / "good").mkdir()
        made = make(Path(folder) / "good")
        for sample in made.values():  # imports what it needs, before memory is bounded
            write(Path(folder) / "first", sample.files)
            sample.read(Path(folder) / "first" / sample.entry)
            shutil.rmtree(Path(folder) / "first")
        _bound_memory()
        os.dup2(os.open(os.devnull, os.O_WRONLY), 2)  # image libraries complain there
        for index in indices:
            kind, mutation, files = damaged(made, seed, index)
            connection.send((kind, mutation))
            place = Path(folder) / "damaged"
            write(place, files)
            result, detail = read(made[kind], place)
            connection.send(Outcome(index, kind, mutation, result, detail))
            shutil.rmtree(place)
    connection.close()


def read(sample: Sample, folder: Path) -> tuple[str, str]:
    """Outcome of reading a damaged sample's folder, and where it failed."""
    from slam.cli import InputError
    from slam.formats import FormatError

    try:
        sample.read(folder / sample.entry)
    except (FormatError, InputError) as error:
        if isinstance(error, FormatError) and "\n" in str(error):
            return TRACEBACK, f"more than one line: {str(error)[:200]!r}"
        return REFUSED, ""
    except MemoryError as error:
        return MEMORY, _where(error)
    except Exception as error:
        return TRACEBACK, _where(error)
    return READ, ""


def _where(error: BaseException) -> str:
    """Type, message and the innermost lines of ours."""
    frames = traceback.extract_tb(error.__traceback__)[-3:]
    places = " < ".join(f"{Path(f.filename).name}:{f.lineno}" for f in reversed(frames))
    return f"{type(error).__name__}: {' '.join(str(error).split())[:120]} ({places})"


def _bound_memory() -> None:
    """From here on the process may take `BYTES` more, where the system can bound it."""
    try:
        import resource
    except ImportError:
        return
    status = Path("/proc/self/statm")
    if status.exists():
        taken = int(status.read_text().split()[0]) * resource.getpagesize()
        resource.setrlimit(resource.RLIMIT_AS, (taken + BYTES, taken + BYTES))
