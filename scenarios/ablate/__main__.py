"""python -m scenarios.ablate NAME: a study over many seeds, with intervals."""

from __future__ import annotations

import sys
from importlib import import_module

from scenarios.ablate.options import STUDIES
from slam.cli import main, nearest

COMMAND = "scenarios.ablate"


def run(arguments: list[str]) -> int:
    """Hand the command line to the study it names; without one, say which there are."""
    if not arguments or arguments[0] in ("-h", "--help"):
        print(f"usage: python -m {COMMAND} NAME [OPTIONS]   (NAME --help tells its options)\n")
        for name, options in STUDIES.items():
            print(f"  {name:<16} {(options.__doc__ or '').splitlines()[0]}")
        return 0
    name, *rest = arguments
    if name not in STUDIES:
        print(f"{COMMAND}: unknown study {name!r}: {nearest(name, STUDIES)}", file=sys.stderr)
        return 2
    sys.argv = [sys.argv[0], *rest]
    study = f"scenarios.ablate.study.{name}"
    return main(STUDIES[name], f"{COMMAND} {name}", lambda options: import_module(study).run(options))


if __name__ == "__main__":
    sys.exit(run(sys.argv[1:]))
