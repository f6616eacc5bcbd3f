"""python -m scenarios.sweep FILE: what a sweep has kept, and why trials failed."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg

from scenarios.sweep.store import contents
from slam.cli import main

COMMAND = "scenarios.sweep"


@dataclass(frozen=True)
class Options:
    """Count what a sweep's file holds, by study and method, and print the tracebacks of failed trials."""

    file: Positional[Annotated[Path, arg(metavar="FILE")]]
    """A sweep.sqlite."""


def run(options: Options) -> None:
    """Counts, cost and tracebacks on stdout."""
    for line in contents(options.file):
        print(line)


if __name__ == "__main__":
    sys.exit(main(Options, COMMAND, run))
