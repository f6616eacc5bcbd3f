"""Trials that take milliseconds, and the processes of a cluster; a file of its own for workers to import."""

from __future__ import annotations

import asyncio
import logging
import math
import os
import signal
import sys
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from threading import Lock

from scenarios.sweep import Answer, SweepResult, Trial, executors, sweep
from slam.cli import InputError

METHODS = ("plain", "odd")
OFTEN = 0.1
"""Seconds after which workers are counted again where they die all the time."""


def trials(drives: int, seconds: float = 0.0, log: str = "") -> list[Trial]:
    """Two methods on every drive."""
    config = {"seconds": seconds, "log": log}
    return [Trial("toy", "flat", seed, method, config) for seed in range(drives) for method in METHODS]


def prepare(scenario: str, seed: int) -> list[float]:
    return [seed / 7.0, math.sqrt(seed)]


def answer(trial: Trial, material: list[float]) -> Answer:
    """A line in the log where there is one, a nap, and numbers that JSON and CSV find hard."""
    if trial.config["log"]:
        with open(trial.config["log"], "a") as file:
            file.write(f"{trial.seed} {trial.method}\n")
    time.sleep(trial.config["seconds"])
    odd = math.nan if trial.method == "odd" else -math.inf
    rows = [{"seed": trial.seed, "method": trial.method, "x": x, "odd": odd} for x in material]
    return Answer(rows, trial.name.encode())


def suicidal(trial: Trial, material: object) -> Answer:
    """One trial kills whoever tries it, and one fails."""
    if (trial.seed, trial.method) == (1, "odd"):
        os.kill(os.getpid(), signal.SIGKILL)
    if (trial.seed, trial.method) == (2, "plain"):
        raise ValueError("no\nluck")
    return answer(trial, material)  # type: ignore[arg-type]


def unpicklable() -> Callable[[str, int], object]:
    """A preparation that holds a lock, which stays on its machine."""
    return partial(lambda lock, scenario, seed: None, Lock())


def threads(trial: Trial, material: object) -> Answer:
    """What limits the threads of a worker, and whether numpy's was said before its process began."""
    names = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "NUMBA_NUM_THREADS")
    at_start = b"OPENBLAS_NUM_THREADS=1" in Path("/proc/self/environ").read_bytes().split(b"\0")
    return Answer([{name: os.environ[name] for name in names} | {"at start": at_start}])


def table(swept: SweepResult) -> list[str]:
    """The answers, bit by bit."""
    return [f"{trial.key} {list(found.rows)!r} {found.payload!r}" for trial, found in swept.answered]


def scheduler(port: int) -> None:
    """A Dask scheduler, as a process."""
    from distributed import Scheduler

    async def serve() -> None:
        async with Scheduler(host="127.0.0.1", port=port, dashboard=False) as one:
            await one.finished()

    logging.disable()
    asyncio.run(serve())


def worker(port: int) -> None:
    """A Dask worker, as a process."""
    from distributed import Worker

    async def serve() -> None:
        address, quiet = f"tcp://127.0.0.1:{port}", logging.CRITICAL
        async with Worker(address, nthreads=1, memory_limit=0, dashboard=False, silence_logs=quiet) as one:
            await one.finished()

    logging.disable()
    asyncio.run(serve())


def sweeper(port: int, store: Path, drives: int, seconds: float, log: str) -> None:
    """A sweep, as a process: exits with 2 when the scheduler goes."""
    executors.POLL_S = OFTEN
    try:
        run = partial(sweep, run_trial=answer, store=store, prepare=prepare)
        run(trials(drives, seconds, log), scheduler=f"tcp://127.0.0.1:{port}")
    except InputError:
        sys.exit(2)
