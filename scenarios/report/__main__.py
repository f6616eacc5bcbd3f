"""python -m scenarios.report RUN … -o FILE: runs side by side; or NAME: pages and pictures that explain."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Annotated, Literal

from tyro.conf import Positional, arg

from slam.cli import InputError, main, nearest

COMMAND = "scenarios.report"
PICTURES = {
    "chapter3": "the worked examples of the report's third chapter, a folder of pictures",
    "corridor": "what a corridor leaves unknown, a picture",
}
"""Name -> what it shows. The module of that name here has ``run(out: Path) -> Path``: write, say where."""

OF_FOLDERS = {
    "audit": "the report's own logs scored against the truth in them: audit FOLDER",
    "album": "the figures of runs as PNG and PDF, one for every stitch too: album RUN …",
    "view": "a run in Rerun: view RUN, or into a file with -o",
}
"""Name -> what it shows. The module of that name here has ``run(folders, out) -> str``, words to print."""


@dataclass(frozen=True)
class Options:
    """Compare runs: RUN … -o compare.html, printed as a table too. Or draw one of the reports."""

    what: Positional[
        Annotated[
            tuple[str, ...], arg(metavar=f"RUN …|{'|'.join([*PICTURES, *OF_FOLDERS])}", help_behavior_hint="")
        ]
    ] = ()
    """Folders of runs or sweeps to compare, or which report, with the folders it is about."""
    out: Annotated[Path | None, arg(aliases=("-o",), metavar="PATH", help_behavior_hint="")] = None
    """Where to write it: a folder, or a file where the report is one."""
    format: Literal["table", "markdown", "latex", "json"] = "table"
    """How a comparison is printed."""


def run(options: Options) -> None:
    """Write the report and print where it is."""
    try:
        words = written(options)
    except OSError as error:
        raise InputError(f"--out {options.out}: cannot be written: {error.strerror}") from error
    print(words)


def written(options: Options) -> str:
    """What the report asked for has to say. Raises `InputError`."""
    name, *rest = options.what or ("",)
    if name in PICTURES:
        if options.out is None:
            raise InputError(f"-o: expected where to write {name}")
        if rest:
            raise InputError(f"{name}: unexpected argument {rest[0]!r}")
        return str(import_module(f"scenarios.report.{name}").run(options.out))
    if name in OF_FOLDERS:
        if not rest:
            raise InputError(f"{name}: expected the folder of a run")
        return str(import_module(f"scenarios.report.{name}").run([Path(word) for word in rest], options.out))
    if not options.what:
        raise InputError(f"expected folders of runs, or one of {', '.join([*PICTURES, *OF_FOLDERS])}")
    folders = [Path(word) for word in options.what if not word.endswith(".html")]  # runs/* has old pages too
    for folder in folders:
        if not folder.is_dir():
            raise InputError(
                f"unknown report {str(folder)!r}: {nearest(str(folder), [*PICTURES, *OF_FOLDERS])}"
            )
    from scenarios.report import compare

    return compare.run(folders, options.out, options.format)


if __name__ == "__main__":
    sys.exit(main(Options, COMMAND, run))
