"""python -m scenarios.bench [NAME]: speed and memory, side by side with others, on one core."""

from __future__ import annotations

import contextlib
import os
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from tyro.conf import Positional, arg

from scenarios.bench.suite import BENCHES, bench
from scenarios.options import check_seed
from slam.cli import InputError, main, nearest

COMMAND = "scenarios.bench"
FUZZ = "fuzz"


@dataclass(frozen=True)
class Options:
    """Measure on one core, in processor time, and print the median and the range of several repetitions.

    The best repetition is what the code can do; how far the others are from it is what else the machine did.
    matching: also success, honesty and accuracy of scan matchers, beside others (extra [peers]) if installed.
    fuzz: damaged files of every format, on all cores; exit code 1 where one is neither read nor refused.
    """

    name: Positional[Annotated[str, arg(metavar="|".join(BENCHES), help_behavior_hint="")]] = ""
    """Which bench to run; all without a name."""
    format: Literal["table", "json"] = "table"
    """What is printed on stdout; json has everything that was measured."""
    pairs: Annotated[int, arg(metavar="N")] = 300
    """matching: pairs of scans of each kind, simulated and from each log."""
    seed: Annotated[int, arg(metavar="K")] = 0
    """matching: what the pairs, their noise and the guesses are drawn from; fuzz: what the damage is."""
    data: Annotated[Path | None, arg(metavar="FOLDER", help_behavior_hint="")] = None
    """matching: folder of the real recordings (carmen/intel.raw.log.gz, usarsim/iro2012-pre2/Robot1.log),
    by default ../shared/data beside the checkout. What is not there is left out."""
    files: Annotated[int, arg(metavar="N")] = 100_000
    """fuzz: how many files are damaged."""


def run(options: Options) -> None:
    """The figures of one bench, or of all."""
    _check(options)

    from rich.console import Console

    from scenarios.bench.result import DATA_FOLDER, BenchmarkOptions, print_result, results_json
    from scenarios.environment import environment
    from scenarios.stages import Stages

    chosen = BenchmarkOptions(options.pairs, options.seed, options.data or DATA_FOLDER, options.files)
    results = {}
    for name in [options.name] if options.name else BENCHES:
        with contextlib.nullcontext() if name == FUZZ else one_core():
            results[name] = bench(name)(Stages(Console(stderr=True)), chosen)
    if options.format == "json":
        print(results_json(results, environment()))
    else:
        for name, result in results.items():
            print_result(name, result, environment())
    if any(result.failures for result in results.values()):
        raise SystemExit(1)


def _check(options: Options) -> None:
    if options.name and options.name not in BENCHES:
        raise InputError(f"unknown bench {options.name!r}: {nearest(options.name, BENCHES)}")
    if options.pairs < 1:
        raise InputError(f"--pairs: expected 1 or more, got {options.pairs}")
    if options.files < 1:
        raise InputError(f"--files: expected 1 or more, got {options.files}")
    check_seed(options.seed)
    if options.data is not None and not options.data.is_dir():
        raise InputError(f"--data: expected a folder, got {options.data}")


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
    sys.exit(main(Options, COMMAND, run))
