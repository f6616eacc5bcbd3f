"""Work spread over processes, its results in the order of the work whoever was first."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor
from itertools import islice
from multiprocessing import get_context
from typing import TypeVar

Task = TypeVar("Task")
Result = TypeVar("Result")

SINGLE = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")


def in_order(work: Callable[[Task], Result], tasks: Iterable[Task], workers: int) -> Iterator[Result]:
    """``work`` of every task, lazily: tasks are drawn as workers become free, a few ahead of what is asked.

    One worker works in this process. Each worker process uses a single thread.
    """
    if workers == 1:
        yield from map(work, tasks)
        return
    for name in SINGLE:
        os.environ.setdefault(name, "1")
    with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool:
        left = iter(tasks)
        waiting = [pool.submit(work, task) for task in islice(left, workers + 1)]
        try:
            while waiting:
                yield waiting.pop(0).result()
                waiting += [pool.submit(work, task) for task in islice(left, 1)]
        finally:
            for future in waiting:
                future.cancel()
