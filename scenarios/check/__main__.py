"""python -m scenarios.check MODULE:METHOD: does a method keep what every method promises?"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from importlib import import_module
from typing import TYPE_CHECKING, Annotated, Literal

from tyro.conf import Positional, arg

from scenarios.methods import METHODS, Method
from slam.cli import InputError, main, nearest

if TYPE_CHECKING:
    from scenarios.check.checks import Finding

COMMAND = "scenarios.check"
VERDICTS = {True: "kept", False: "BROKEN", None: "–"}


@dataclass(frozen=True)
class Options:
    """Try a method on small made drives: the same bytes twice, no look at the truth, a finite pose for every
    scan, honest refusals, and what else every method promises. Exit code 1 where a promise is broken."""

    method: Positional[Annotated[str, arg(metavar="MODULE:METHOD", help_behavior_hint="")]]
    """A function (Recording, MethodConfig) -> Estimate | NoEstimate or a `scenarios.methods.Method`, of a
    module that can be imported from here; or the name of a method of ours."""
    format: Literal["table", "json"] = "table"
    """What is printed on stdout."""


def run(options: Options) -> None:
    """Every check in its turn and a line for each; exit code 1 where one is broken. Raises `InputError`."""
    method = find_method(options.method)

    from rich.console import Console

    from scenarios.check.checks import findings
    from scenarios.jsonable import document

    console, found = Console(stderr=True), []
    for finding in findings(method):
        console.print(f"{finding.check} …", style="dim", highlight=False, markup=False)
        found.append(finding)
    if options.format == "json":
        print(document(method=method.name, findings=found))
    else:
        print(in_words(method.name, found))
    if any(one.passed is False for one in found):
        raise SystemExit(1)


def find_method(name: str) -> Method:
    """The method of that name, or of that module. Raises `InputError`."""
    if name in METHODS:
        return METHODS[name]
    module, _, attribute = name.partition(":")
    if not attribute:
        raise InputError(f"unknown method {name!r}: {nearest(name, [*METHODS, 'MODULE:METHOD'])}")
    if "" not in sys.path:  # as python -m has it, and a console script has not
        sys.path.insert(0, "")
    try:
        found = getattr(import_module(module), attribute)
    except Exception as error:  # whatever the module does when it is imported
        kind = f"{type(error).__name__}: {error}"
        raise InputError(f"method {name!r} cannot be imported: {kind}") from error
    if isinstance(found, Method):
        return found
    if not callable(found):
        raise InputError(f"method {name!r}: expected a function, got {type(found).__name__}")
    return Method(attribute, found)


def in_words(name: str, found: list[Finding]) -> str:
    """A line for every check, and the verdict."""
    width = max(len(one.check) for one in found)
    lines = [f"{VERDICTS[one.passed]:<6}  {one.check:<{width}}  {one.words}" for one in found]
    broken = sum(one.passed is False for one in found)
    verdict = (
        "keeps what every method promises" if not broken else f"breaks {broken} of {len(found)} promises"
    )
    return "\n".join([*lines, f"{name} {verdict}"])


if __name__ == "__main__":
    sys.exit(main(Options, COMMAND, run))
