"""python -m scenarios.suite export|answer|score|page: a frozen benchmark that others enter."""

from __future__ import annotations

import sys
from importlib import import_module

from scenarios.suite.options import PARTS
from slam.cli import main, nearest

COMMAND = "scenarios.suite"


def run(arguments: list[str]) -> int:
    """Hand the command line to the part it names; without one, say which there are."""
    if not arguments or arguments[0] in ("-h", "--help"):
        print(f"usage: python -m {COMMAND} NAME [OPTIONS]   (NAME --help tells its options)\n")
        for name, options in PARTS.items():
            print(f"  {name:<8} {(options.__doc__ or '').splitlines()[0]}")
        return 0
    name, *rest = arguments
    if name not in PARTS:
        print(f"{COMMAND}: unknown name {name!r}: {nearest(name, PARTS)}", file=sys.stderr)
        return 2
    sys.argv = [sys.argv[0], *rest]
    part = f"{COMMAND}.{name}"
    return main(PARTS[name], f"{COMMAND} {name}", lambda options: import_module(part).run(options))


if __name__ == "__main__":
    sys.exit(run(sys.argv[1:]))
