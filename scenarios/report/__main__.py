"""python -m scenarios.report RUN … -o FILE: runs side by side; or NAME: pages and pictures that explain."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Annotated, Literal

from tyro.conf import Positional, arg

from slam.cli import InputError, main, nearest

COMMAND = "scenarios.report"
PICTURES = {"chapter3": "chapter3", "corridor": "corridor"}
"""Name -> the module here whose ``run(out: Path) -> Path`` draws pictures and returns where they are: the
worked examples of the thesis' third chapter; what a corridor leaves unknown."""
OF_FOLDERS = {"audit": "audit", "album": "figures", "view": "view"}
"""Name -> the module here whose ``run(folders, out) -> str`` returns text to print: the logs of the thesis
scored against the truth in them; the figures of runs, with one for every stitch; a run in Rerun."""
NAMES = (*PICTURES, *OF_FOLDERS)


@dataclass(frozen=True)
class Options:
    """Compare runs: RUN … -o compare.html, printed as a table too. Or name what to draw or print."""

    what: Positional[
        Annotated[tuple[str, ...], arg(metavar=f"RUN …|{'|'.join(NAMES)}", help_behavior_hint="")]
    ] = ()
    """Folders of runs or sweeps to compare, or a name, with the folders it is about."""
    out: Annotated[Path | None, arg(aliases=("-o",), metavar="PATH", help_behavior_hint="")] = None
    """Where to write it: a folder, or a file where the result is one."""
    format: Literal["table", "markdown", "latex", "json"] = "table"
    """How a comparison is printed."""


def run(options: Options) -> None:
    """Write what is asked for and print its text. Raises `InputError`."""
    try:
        text = write(options.what, options.out, options.format)
    except OSError as error:
        raise InputError(f"--out {options.out}: cannot be written: {error.strerror}") from error
    print(text)


def write(what: Sequence[str], out: Path | None, form: str) -> str:
    """Write what is asked for; returns its text. Raises `InputError`, and ``OSError`` for a place that cannot
    be written."""
    name, *rest = what or ("",)
    if name in PICTURES:
        if out is None:
            raise InputError(f"-o: expected where to write {name}")
        if rest:
            raise InputError(f"{name}: unexpected argument {rest[0]!r}")
        return str(import_module(f"scenarios.report.{PICTURES[name]}").run(out))
    if name in OF_FOLDERS:
        if not rest:
            raise InputError(f"{name}: expected the folder of a run")
        module = import_module(f"scenarios.report.{OF_FOLDERS[name]}")
        return str(module.run([Path(word) for word in rest], out))
    if not what:
        raise InputError(f"expected folders of runs, or one of {', '.join(NAMES)}")
    folders = [Path(word) for word in what if not word.endswith(".html")]  # runs/* may have pages
    for folder in folders:
        if not folder.is_dir():
            raise InputError(f"unknown report {str(folder)!r}: {nearest(str(folder), NAMES)}")
    from scenarios.report import compare

    return compare.run(folders, out, form)


if __name__ == "__main__":
    sys.exit(main(Options, COMMAND, run))
