"""python -m scenarios.bench [NAME]: speed and memory, side by side with others, on one core."""

from __future__ import annotations

import contextlib
import os
import sys
from collections.abc import Iterator

from scenarios.bench.result import BenchmarkOptions, print_result, results_json
from scenarios.bench.suite import BENCHES, bench
from scenarios.options import check_seed
from slam.cli import InputError, main, nearest

COMMAND = "scenarios.bench"
FUZZ = "fuzz"


def run(options: BenchmarkOptions) -> None:
    """The figures of one bench, or of all."""
    if options.name and options.name not in BENCHES:
        raise InputError(f"unknown bench {options.name!r}: {nearest(options.name, BENCHES)}")
    if options.pairs < 1:
        raise InputError(f"--pairs: expected 1 or more, got {options.pairs}")
    if options.files < 1:
        raise InputError(f"--files: expected 1 or more, got {options.files}")
    check_seed(options.seed)
    if options.data is not None and not options.data.is_dir():
        raise InputError(f"--data: expected a folder, got {options.data}")

    from rich.console import Console

    from scenarios.stages import Stages, environment

    results = {}
    for name in [options.name] if options.name else BENCHES:
        with contextlib.nullcontext() if name == FUZZ else one_core():
            results[name] = bench(name)(Stages(Console(stderr=True)), options)
    if options.format == "json":
        print(results_json(results, environment()))
    else:
        for name, result in results.items():
            print_result(name, result, environment())
    if any(result.failures for result in results.values()):
        raise SystemExit(1)


@contextlib.contextmanager
def one_core() -> Iterator[None]:
    """Keep this process on one core, where the system lets it."""
    if not hasattr(os, "sched_setaffinity"):
        yield
        return
    allowed = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {max(allowed)})
    try:
        yield
    finally:
        os.sched_setaffinity(0, allowed)


if __name__ == "__main__":
    sys.exit(main(BenchmarkOptions, COMMAND, run))
