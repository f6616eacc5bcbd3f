"""python -m scenarios.bench [NAME]: speed and memory, side by side with others, on one core."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Annotated, Literal

from tyro.conf import Positional, arg

from scenarios.bench.suite import BENCHES, bench
from scenarios.cli import BadInput, main, nearest

COMMAND = "scenarios.bench"


@dataclass(frozen=True)
class Options:
    """Measure on one core, in processor time, and print the median and the range of several repetitions.

    The best repetition is what the code can do; how far the others are from it is what else the machine did.
    """

    name: Positional[Annotated[str, arg(metavar="|".join(BENCHES), help_behavior_hint="")]] = ""
    """Which bench to run; all without a name."""
    format: Literal["table", "json"] = "table"
    """What is printed on stdout."""


def run(options: Options) -> None:
    """The figures of one bench, or of all."""
    if options.name and options.name not in BENCHES:
        raise BadInput(f"unknown bench {options.name!r}: {nearest(options.name, BENCHES)}")

    from rich.console import Console

    from scenarios.bench.table import figures_json, print_figures
    from scenarios.environment import environment
    from scenarios.stages import Stages

    names = [options.name] if options.name else BENCHES
    with one_core():
        measured = {name: bench(name)(Stages(Console(stderr=True))) for name in names}
    if options.format == "json":
        print(figures_json(measured, environment()))
        return
    for name, figures in measured.items():
        print_figures(name, figures, environment())


@contextmanager
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
