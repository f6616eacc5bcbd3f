"""python -m scenarios.report NAME -o PATH: pages and pictures that explain, rather than score."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg

from scenarios.cli import BadInput, main, nearest

COMMAND = "scenarios.report"
REPORTS = {
    "chapter3": "the worked examples of the report's third chapter, a folder of pictures",
    "corridor": "what a corridor leaves unknown, a picture",
}
"""Name -> what it shows. The module of that name here has ``run(out: Path) -> Path``: write, say where."""


@dataclass(frozen=True)
class Options:
    """Draw one of the reports."""

    name: Positional[Annotated[str, arg(metavar="|".join(REPORTS), help_behavior_hint="")]] = ""
    """Which report."""
    out: Annotated[Path | None, arg(aliases=("-o",), metavar="PATH", help_behavior_hint="")] = None
    """Where to write it: a folder, or a file where the report is one."""


def run(options: Options) -> None:
    """Write the report and print where it is."""
    if options.name not in REPORTS:
        raise BadInput(f"unknown report {options.name!r}: {nearest(options.name, REPORTS)}")
    if options.out is None:
        raise BadInput(f"-o: expected where to write {options.name}")
    try:
        print(import_module(f"scenarios.report.{options.name}").run(options.out))
    except OSError as error:
        raise BadInput(f"--out {options.out}: cannot be written: {error.strerror}") from error


if __name__ == "__main__":
    sys.exit(main(Options, COMMAND, run))
