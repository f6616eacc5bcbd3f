"""What every command shares: options from a data class, bad input as one line and exit code 2."""

from __future__ import annotations

import contextlib
import difflib
import io
import sys
from collections.abc import Callable, Iterable
from typing import TypeVar

Options = TypeVar("Options")


class BadInput(ValueError):
    """What the user gave cannot be used; the message is one line that says what was expected."""


def main(options: type[Options], command: str, run: Callable[[Options], None]) -> int:
    """Parse the command line into ``options``, run, and return the exit code: 0 done, 2 bad input.

    Any other exception is a bug and shows its traceback (exit code 1).
    """
    from slam.formats.errors import FormatError

    try:
        run(parse(options, command))
    except (BadInput, FormatError) as error:
        print(f"{command}: {' '.join(str(error).split())}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print(f"{command}: interrupted", file=sys.stderr)
        return 130
    return 0


def parse(options: type[Options], command: str) -> Options:
    """The command line as ``options``. Raises `BadInput` where tyro would draw a box over several lines."""
    import tyro

    complaint = io.StringIO()
    try:
        with contextlib.redirect_stderr(complaint):
            return tyro.cli(options, prog=f"python -m {command}")
    except SystemExit as stop:
        if not stop.code:
            raise
        raise BadInput(_one_line(complaint.getvalue())) from None


def _one_line(box: str) -> str:
    """The complaint in tyro's box: the text below its title, and the option it thinks was meant."""
    lines = [line.strip(" │╭╮╰╯") for line in box.splitlines()]
    rules = [k for k, line in enumerate(lines) if line and not line.strip("─-")]
    body = lines[rules[0] + 1 : rules[1]] if len(rules) > 1 else lines
    text = " ".join(line for line in body if line)
    if "Perhaps you meant:" in lines:
        text += f" (perhaps {lines[lines.index('Perhaps you meant:') + 1].split()[0]}?)"
    return text.split(" Got errors:")[0] or "the command line could not be understood"


def nearest(name: str, known: Iterable[str]) -> str:
    """``: did you mean …?`` for a misspelt name, or the names there are."""
    names = list(known)
    close = difflib.get_close_matches(name, names, n=1, cutoff=0.5)
    return f"did you mean {close[0]!r}?" if close else f"expected one of {', '.join(names)}"
