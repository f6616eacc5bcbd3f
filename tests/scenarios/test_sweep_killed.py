"""Sweeps whose processes are killed: nothing is lost, nothing is done twice, the table is the same."""

from __future__ import annotations

import json
import multiprocessing
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import closing
from multiprocessing.process import BaseProcess
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from scenarios.sweep import Answer, executors, sweep
from scenarios.sweep.store import opened
from scenarios.sweep.version import code_version
from slam.cli import InputError

pytestmark = pytest.mark.study
HERE, CHECKOUT = Path(__file__).parent, Path(__file__).parents[2]
DRIVES, SECONDS = 100, 0.02


@pytest.fixture
def toy(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """The module of toy trials, for this process and those that it starts."""
    monkeypatch.syspath_prepend(str(HERE))
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(HERE), str(CHECKOUT)]))
    code_version.cache_clear()  # as a process that has just been started finds it
    import toy_sweep

    return toy_sweep


class House:
    """A scheduler, two workers and a sweep, each a process that can be killed and replaced in an instant."""

    def __init__(self, toy: ModuleType, store: Path, log: Path) -> None:
        self.toy, self.store, self.log = toy, store, log
        self.context = multiprocessing.get_context("forkserver")
        self.context.set_forkserver_preload(["distributed", "scenarios.sweep.executors", "toy_sweep"])
        with closing(socket.socket()) as free:
            free.bind(("127.0.0.1", 0))
            self.port = free.getsockname()[1]
        self.members = {name: self.start(name) for name in ("scheduler", "worker 1", "worker 2", "sweep")}

    def start(self, name: str) -> BaseProcess:
        what = {"s": self.toy.scheduler, "w": self.toy.worker}.get(name[0])
        arguments: tuple[object, ...] = (self.port,)
        if name == "sweep":
            what, arguments = self.toy.sweeper, (self.port, self.store, DRIVES, SECONDS, str(self.log))
        process = self.context.Process(target=what, args=arguments, daemon=True)
        process.start()
        return process

    def kill(self, name: str) -> None:
        self.members[name].kill()
        self.members[name].join()

    def replace(self, name: str) -> None:
        self.kill(name)
        self.members[name] = self.start(name)

    def work(self, trials: int) -> None:
        """Wait until so many more trials are begun, or the sweep is over."""
        enough = len(begun(self.log)) + trials
        _wait(lambda: len(begun(self.log)) >= enough or self.members["sweep"].exitcode is not None)


@pytest.fixture
def house(toy: ModuleType, tmp_path: Path) -> Iterator[House]:
    one = House(toy, tmp_path / "sweep.sqlite", tmp_path / "log")
    yield one
    for name in one.members:
        one.kill(name)


def answered(store: Path) -> set[tuple[int, str]]:
    """Seed and method of what a file holds; nobody may be writing to it."""
    with opened(store) as held:
        return set(held.connection.execute("SELECT seed, method FROM trial WHERE traceback IS NULL"))


def begun(log: Path) -> list[tuple[int, str]]:
    """Seed and method of trials as they were begun."""
    lines = log.read_text().splitlines() if log.exists() else []
    return [(int(seed), method) for seed, method in (line.split() for line in lines)]


def test_twelve_kills_change_nothing(
    toy: ModuleType, house: House, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Sweep, worker or scheduler die at random moments, some before they have begun to work; the sweep is
    started again where it died."""
    rng = np.random.default_rng(0)
    victims = rng.permutation(["sweep", "worker 1", "worker 2", "scheduler"] * 3)
    known: set[tuple[int, str]] = set()
    for victim in victims:
        house.work(rng.choice([0, 2, 5]))
        time.sleep(rng.uniform(0.0, 0.3))
        if victim == "scheduler":  # its workers and its sweep leave, too
            house.kill("scheduler")
            house.members["sweep"].join(20.0)
            assert house.members["sweep"].exitcode in (0, 2)
        if victim in ("sweep", "scheduler"):
            house.kill("sweep")
            now = answered(house.store)
            assert known <= now
            known, before = now, len(begun(house.log))
            if victim == "scheduler":
                for name in ("scheduler", "worker 1", "worker 2"):
                    house.replace(name)
            house.replace("sweep")
        else:
            house.replace(victim)
    house.members["sweep"].join(60.0)
    assert house.members["sweep"].exitcode == 0
    assert len(known) > 10
    assert not known & set(begun(house.log)[before:])
    asked = toy.trials(DRIVES, SECONDS, str(house.log))
    survived = sweep(asked, toy.answer, house.store, prepare=toy.prepare)
    assert (survived.ran, survived.reused) == (0, 2 * DRIVES)
    calm = toy.trials(DRIVES, SECONDS, str(house.log))
    monkeypatch.setattr(time, "sleep", lambda seconds: None)  # trials nap
    undisturbed = sweep(calm, toy.answer, tmp_path / "calm.sqlite", prepare=toy.prepare, workers=1)
    assert toy.table(survived) == toy.table(undisturbed)


def test_whoever_kills_its_workers_is_recorded_and_the_others_go_on(toy: ModuleType, tmp_path: Path) -> None:
    """Processes of this machine: one trial dies with every worker that tries it, one raises."""
    store = tmp_path / "sweep.sqlite"
    swept = sweep(toy.trials(3), toy.suicidal, store, prepare=toy.prepare, workers=2)
    assert [(trial.seed, trial.method, found.line) for trial, found in swept.failed] == [
        (1, "odd", "4 workers died of it: killed, or out of memory"),
        (2, "plain", "ValueError: no luck"),
    ]
    assert len(swept.answered) == 4
    again = sweep(toy.trials(3), toy.answer, store, prepare=toy.prepare, workers=1)
    assert (again.ran, again.reused, again.failed) == (2, 4, [])


def test_a_cluster_that_cannot_be_closed_keeps_what_was_answered(
    toy: ModuleType, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As Dask's cannot while it replaces a worker that died."""
    from distributed import LocalCluster

    close = LocalCluster.close

    def fails(cluster: LocalCluster) -> None:
        close(cluster)
        raise AssertionError("can only join a started process")

    monkeypatch.setattr(LocalCluster, "close", fails)
    assert len(sweep(toy.trials(2), toy.answer, None, prepare=toy.prepare, workers=2).answered) == 4


def test_workers_that_die_as_they_start_end_the_sweep(
    toy: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What prepares a worker ends its process instead."""
    (tmp_path / "deadly.py").write_text("import os; os._exit(1)")
    monkeypatch.setattr(executors, "PRELOAD", str(tmp_path / "deadly.py"))
    with pytest.raises(InputError, match="workers die as they start"):
        sweep(toy.trials(3), toy.answer, None, workers=2)


def test_a_worker_has_one_thread_and_functions_that_cannot_be_sent_are_refused(toy: ModuleType) -> None:
    """The threads of numpy are limited before it is loaded: when the process starts."""
    with pytest.raises(InputError, match=r"cannot run trials: .*serialize"):
        sweep(toy.trials(1), toy.answer, None, prepare=toy.unpicklable(), workers=2)
    alone = sweep(toy.trials(1), toy.threads, None, workers=2)
    limits = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "NUMBA_NUM_THREADS": "1"}
    assert [answer.rows for _, answer in alone.answered] == [[limits | {"at start": True}]] * 2


def test_workers_of_a_killed_sweep_do_not_outlive_it(toy: ModuleType, tmp_path: Path) -> None:
    """Nor those of an interrupted one, which says so in one line."""
    code = (
        "import sys, toy_sweep as toy, signal; from pathlib import Path; from scenarios.sweep import sweep;"
        "signal.signal(signal.SIGINT, signal.default_int_handler);"  # else as the shell has it
        "from slam import cli; from dataclasses import make_dataclass;"
        "O = make_dataclass('O', []); trials = toy.trials(9, 5.0, sys.argv.pop());"
        "go = lambda o: sweep(trials, toy.answer, None, prepare=toy.prepare, workers=2);"
        "sys.exit(cli.main(O, 'toy', go))"
    )
    ends = {signal.SIGKILL: -9, signal.SIGINT: 130}
    logs = {number: tmp_path / f"log{number}" for number in ends}
    processes = {
        number: subprocess.Popen([sys.executable, "-c", code, str(log)], stderr=subprocess.PIPE, text=True)
        for number, log in logs.items()
    }
    for number, process in processes.items():
        _wait(lambda number=number: len(begun(logs[number])) >= 2)
        children = _children(process.pid)
        assert sum("spawn_main" in command for command in children.values()) == 2
        process.send_signal(number)
        assert process.wait(20.0) == ends[number]
        _wait(lambda pids=tuple(children): not any(Path(f"/proc/{pid}/cmdline").exists() for pid in pids))
    assert processes[signal.SIGINT].stderr.read() == "toy: interrupted\n"  # type: ignore[union-attr]


def _children(parent: int) -> dict[int, str]:
    """Commands of the processes that a process has started, by their number."""
    command = ["ps", "-ww", "-o", "pid=,args=", "--ppid", str(parent)]
    listed = subprocess.run(command, capture_output=True, text=True).stdout
    return {int(pid): arguments for pid, arguments in (line.split(None, 1) for line in listed.splitlines())}


def _wait(until) -> None:
    deadline = time.monotonic() + 30.0
    while not until():
        assert time.monotonic() < deadline
        time.sleep(0.05)


def test_a_cluster_from_the_shell_answers_as_this_process_does(toy: ModuleType, tmp_path: Path) -> None:
    address = tmp_path / "scheduler.json"
    dask, quiet = [sys.executable, "-m", "dask"], ["--scheduler-file", str(address), "--no-dashboard"]
    told = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL, "cwd": CHECKOUT}
    started = [subprocess.Popen([*dask, "scheduler", "--port", "0", *quiet], **told)]  # type: ignore[call-overload]
    worker = [*dask, "worker", "--nthreads", "1", "--no-nanny", *quiet]
    started += [subprocess.Popen(worker, **told) for _ in range(2)]  # type: ignore[call-overload]
    try:
        _wait(lambda: address.exists() and address.read_text().rstrip().endswith("}"))
        where = json.loads(address.read_text())["address"]
        there = sweep(toy.trials(8), toy.answer, None, prepare=toy.prepare, scheduler=where)
    finally:
        for process in started:
            process.kill()
            process.wait()
    here = sweep(toy.trials(8), toy.answer, None, prepare=toy.prepare, workers=1)
    assert toy.table(there) == toy.table(here)
    assert all(isinstance(found, Answer) for found in there.answers)
