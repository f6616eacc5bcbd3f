"""What every command shares: options from a data class, bad input as one line and exit code 2."""

from __future__ import annotations

import contextlib
import difflib
import io
import math
import os
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import fields, replace
from typing import TypeVar, get_type_hints

import tyro
from tyro.constructors import PrimitiveConstructorSpec

Options = TypeVar("Options")
Take = Callable[[list[str]], tuple[Mapping[str, Sequence[str]], list[str]]]
"""Words of a command line → settings by key, and the words that are none."""


class InputError(ValueError):
    """What the user gave cannot be used; the message is one line that says what was expected."""


class RefusedError(Exception):
    """There is no answer that could be believed; the message is the reason, in one line."""


def main(
    options: type[Options],
    command: str,
    run: Callable[[Options], None],
    take: Take | None = None,
) -> int:
    """Parse the command line into ``options``, run, and return the exit code.

    ``take`` takes words out of the command line before (settings of a tree, as ``--slam.loops.length 4``);
    they become the options' field ``settings``.

    0 done, 2 bad input, 3 refused, 130 interrupted, 141 when nobody reads the output any more. Any other
    exception is a bug and shows its traceback (exit code 1).
    """
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="replace")  # an arrow that a terminal cannot show must not end a run
    try:
        run(parse(options, command, take))
        sys.stdout.flush()
    except (InputError, RefusedError) as error:
        print(f"{command}: {' '.join(str(error).split())}", file=sys.stderr)
        return 2 if isinstance(error, InputError) else 3
    except KeyboardInterrupt:
        print(f"{command}: interrupted", file=sys.stderr)
        return 130
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # or Python complains when it flushes
        return 141
    return 0


def parse(options: type[Options], command: str, take: Take | None = None) -> Options:
    """The command line as ``options``. Raises `InputError` where tyro would draw a box over several lines."""
    given, words = ({}, sys.argv[1:]) if take is None else take(sys.argv[1:])
    complaint = io.StringIO()
    try:
        with contextlib.redirect_stderr(complaint):
            parsed, unknown = tyro.cli(
                options,
                args=words,
                prog=f"python -m {command}",
                return_unknown_args=True,
                config=(tyro.conf.FlagCreatePairsOff,),
            )
    except SystemExit as stop:
        if not stop.code:  # --help
            raise
        raise InputError(_first_paragraph(complaint.getvalue())) from None
    if unknown:
        raise InputError(_not_understood(unknown[0], options))
    return replace(parsed, settings=given) if given else parsed  # type: ignore[type-var]


def _first_paragraph(box: str) -> str:
    """What tyro's box says between its title and the first line across it or between its words."""
    lines = [line.strip(" │") for line in box.splitlines()[1:]]
    end = next((k for k, line in enumerate(lines) if not line.strip("─╰╯")), len(lines))
    return " ".join(lines[:end]) or "the command line could not be understood"


def _not_understood(word: str, options: type) -> str:
    if not word.startswith("-"):
        return f"unexpected argument {word!r}"
    hints = get_type_hints(options, include_extras=True)
    unnamed = {tyro.conf.Positional, tyro.conf.Suppress}
    named = (f.name for f in fields(options) if not unnamed & set(_metadata(hints[f.name])))
    flag = word.split("=")[0]
    return f"unknown option {flag!r}: {nearest(flag, ['--help', *map(_flag, named)])}"


def _flag(name: str) -> str:
    return "--" + name.replace("_", "-")


def _metadata(hint: object) -> tuple[object, ...]:
    return getattr(hint, "__metadata__", ())


def nearest(name: str, known: Iterable[str]) -> str:
    """``did you mean …?`` for a misspelt name, or the names there are."""
    names = list(known)
    close = difflib.get_close_matches(name, names, n=1)
    return f"did you mean {close[0]!r}?" if close else f"expected one of {', '.join(names)}"


Pose = tuple[float, float, float]


def _pose(words: Sequence[str]) -> Pose:
    x, y, yaw = map(float, words)
    if not all(map(math.isfinite, (x, y, yaw))):
        raise ValueError(f"expected three finite numbers, got {' '.join(words)}")
    return x, y, yaw


POSE = PrimitiveConstructorSpec[Pose | None](
    nargs=3,
    metavar="X Y YAW",
    instance_from_str=_pose,
    is_instance=lambda value: value is None or isinstance(value, tuple),
    str_from_instance=lambda value: [] if value is None else [str(number) for number in value],
)
"""For an option that is a pose or absent: exactly three words, so that a file name may follow them."""
