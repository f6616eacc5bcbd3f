"""What ``--corrupt`` asks for: corruptions by name and severity, put on a recording before anything else is
done with it."""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated

import tyro
from tyro.conf import arg

from slam.cli import InputError, nearest

if TYPE_CHECKING:
    from sim.corruption import Corruption, Kind
    from slam.recording import Recording
    from slam.table import Table

Corrupt = Annotated[
    tuple[str, ...],
    tyro.conf.UseAppendAction,
    arg(metavar="KIND[=SEVERITY]", help_behavior_hint=""),
]
"""An option that may be given again and again, in the order in which the recording is spoilt."""
STREAM = 6
"""What keeps the draws of corruptions apart from those of the simulator with the same seed."""
LONGEST = 100
"""Characters of a run's name that corruptions may take."""


def parse_corruptions(words: Sequence[str]) -> tuple[Corruption, ...]:
    """Corruptions of words like ``odometry.frozen=3``; without a number at their default severity. Raises
    `InputError`."""
    from sim.corruption import CORRUPTIONS

    return tuple(_parse(word, CORRUPTIONS) for word in words)


def _parse(word: str, known: dict[str, Kind]) -> Corruption:
    name, equals, number = word.partition("=")
    if name not in known:
        raise InputError(f"--corrupt {word}: unknown corruption {name!r}: {nearest(name, known)}")
    try:
        severity = float(number) if equals else None
    except ValueError:
        raise InputError(f"--corrupt {word}: expected a number after {name}=, got {number!r}") from None
    try:
        return known[name].at(severity)
    except ValueError as error:
        raise InputError(f"--corrupt {error}") from error


def corrupted(recording: Recording, corruptions: Sequence[Corruption], seed: int) -> Recording:
    """The spoilt recording; what chance has a part in is drawn by ``seed``. Raises `InputError` for a
    recording that lacks what is spoilt."""
    import numpy as np

    from sim.corruption import corrupt

    try:
        return corrupt(recording, corruptions, np.random.default_rng([seed, STREAM]))
    except ValueError as error:
        raise InputError(f"--corrupt {error}") from error


def name_part(corruptions: Sequence[Corruption]) -> str:
    """What a run's name says of them: ``-odometry.frozen-3``."""
    name = "".join(f"-{one}".replace("=", "-") for one in corruptions)
    return name if len(name) <= LONGEST else f"{name[:LONGEST]}-{zlib.crc32(name.encode()):08x}"


def told(recording: Recording) -> list[str]:
    """What was done to a recording, each corruption with its meaning."""
    from sim.corruption import CORRUPTIONS

    words = []
    for text in recording.corruptions:
        kind = CORRUPTIONS.get(text.partition("=")[0])
        words.append(text if kind is None else f"{text} ({kind.does})")
    return words


def table() -> Table:
    """All corruptions there are, a row each."""
    from sim.corruption import CORRUPTIONS
    from slam.table import ABSENT, Table

    rows = []
    for kind in CORRUPTIONS.values():
        much = kind.severity
        needs = "dead reckoning" if kind.needs_dead_reckoning else ""
        if much is None:
            rows.append((kind.name, kind.does, "", needs, *[ABSENT] * 3))
            continue
        meaning = much.meaning + (f" [{much.unit}]" if much.unit else "")
        levels = " / ".join(f"{level:g}" for level in much.levels)
        allowed = f"{much.least:g} … {much.most:g}"
        rows.append((kind.name, kind.does, meaning, needs, f"{much.default:g}", levels, allowed))
    columns = ("corruption", "what it does", "severity", "needs", "default", "low / medium / high", "allowed")
    return Table(columns, rows, names=4)
