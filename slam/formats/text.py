"""Files read once, their lines and numbers, and what is wrong with them in one line."""

from __future__ import annotations

import codecs
import math
import re
from collections import Counter
from collections.abc import Iterator, Sequence
from functools import cached_property
from os import PathLike
from pathlib import Path

import numpy as np

from slam.formats import foreign, packed
from slam.recording import Laser
from slam.se2 import Array

BYTE_ORDER_MARKS = {
    codecs.BOM_UTF8: "utf-8-sig",
    codecs.BOM_UTF16_LE: "utf-16",
    codecs.BOM_UTF16_BE: "utf-16",
}
"""First bytes of text files from Windows → their encoding."""
NOT_FINITE = re.compile(r"[-+]?(1\.#\w+|s?nan(\(\w*\))?)", re.IGNORECASE)
"""How C libraries print what is not a finite number, where Python does not read it: 1.#INF, -nan(ind)."""
CONTROL = re.compile(rb"[\x00-\x08\x0e-\x1f]")
"""Bytes that are in no text."""
ODD_SCANS = 0.1
"""Share of the scans that may have another number of beams; they are left out."""
LARGEST = 1e30
"""No measured number is larger, and its square is still a number."""
MOST = 9_999_999
"""Larger counts are no counts."""


class FormatError(ValueError):
    """A file that cannot be read: ``path:line: what was wrong, what was expected``, in one line.

    ``line`` counts from 1 and is None where the whole file is meant.
    """

    def __init__(
        self, message: str, path: str | PathLike[str] | None = None, line: int | None = None
    ) -> None:
        self.path = path
        self.line = line
        where = "" if path is None else f"{path}: " if line is None else f"{path}:{line}: "
        super().__init__(where + " ".join(message.split()))


class File:
    """A file that is read at most once, when its content is first asked for; given ``data``, never.

    ``field_of_view``: what the user says that the laser in it spans, in degrees; None: as the file says. Of a
    ROS bag the user may name the laser's ``topic`` and the ``odometry``.
    """

    def __init__(
        self,
        path: str | PathLike[str],
        data: bytes | None = None,
        field_of_view: float | None = None,
        topic: str = "",
        odometry: str = "",
    ) -> None:
        self.path = Path(path)
        self.field_of_view = field_of_view
        self.topic, self.odometry = topic, odometry
        if data is not None:
            self.__dict__["data"] = data

    @classmethod
    def of(cls, source: File | str | PathLike[str]) -> File:
        """The file at a path, or the one given."""
        return source if isinstance(source, File) else cls(source)

    @cached_property
    def data(self) -> bytes:
        """The bytes, unpacked where they are compressed (`packed.PACKINGS`).

        Raises `FormatError` for a file that is missing, unreadable, a directory, empty, or torn.
        """
        return _read_bytes(self.path)

    @cached_property
    def text(self) -> str:
        """The text with ``\\n`` line ends. Raises `FormatError` where it is binary, or as `data` does."""
        mark = next((mark for mark in BYTE_ORDER_MARKS if self.data.startswith(mark)), None)
        nul = self.data.find(b"\0")
        if nul >= 0 and (mark is None or mark == codecs.BOM_UTF8):
            raise self._binary(nul)
        text = self.data.decode(BYTE_ORDER_MARKS[mark] if mark else "utf-8", errors="replace")
        return text.replace("\r\n", "\n") if "\n" in text else text.replace("\r", "\n")

    def _binary(self, nul: int) -> FormatError:
        """What to say of a file whose byte ``nul`` is zero."""
        kind = foreign.describe(self.data)
        if kind is not None:
            return FormatError(kind, self.path)
        line = self.data.count(b"\n", 0, nul) + 1
        message = "a zero byte, expected text: was the log cut off? remove what follows"
        if line == 1 or CONTROL.search(self.data, 0, nul):
            return FormatError("not text, and of no kind that is known here", self.path)
        return FormatError(message, self.path, line)

    def lines(self) -> Iterator[tuple[int, str]]:
        """Every line with its number, from 1. Raises `FormatError` as `text` does."""
        return enumerate(self.text.split("\n"), start=1)

    def records(self) -> Iterator[tuple[int, list[str]]]:
        """Line number and words of every line that is neither blank nor a comment (``#``)."""
        for number, line in self.lines():
            words = line.split()
            if words and not words[0].startswith("#"):
                yield number, words

    def rows(self, what: str, columns: str, more: bool = False) -> Iterator[tuple[int, list[float]]]:
        """Line number and values of every record, which has the ``columns`` named, or ``more`` that are
        dropped. Raises `FormatError` for a record, called ``what``, of other values."""
        count = len(columns.split())
        for number, words in self.records():
            if len(words) < count or (len(words) > count and not more):
                expected = f"{'at least ' if more else ''}{count}: {columns}"
                raise FormatError(f"{what} of {len(words)} values, expected {expected}", self.path, number)
            yield number, numbers(words[:count], what, self.path, number)


def _read_bytes(path: Path) -> bytes:
    try:
        data = path.read_bytes()
    except FileNotFoundError:
        raise FormatError("no such file", path) from None
    except IsADirectoryError:
        raise FormatError("is a directory, expected a file", path) from None
    except OSError as error:
        raise FormatError(f"cannot be read: {error.strerror}", path) from None
    try:
        data = packed.unpack(data)
    except ValueError as error:
        raise FormatError(str(error), path) from None
    if not data or data.isspace():
        raise FormatError("the file is empty", path)
    return data


def numbers(words: Sequence[str], what: str, path: Path, line: int) -> list[float]:
    """The words as floats. Raises `FormatError` naming the first that is none, is not finite, or is beyond
    `LARGEST`."""
    try:
        values = list(map(float, words))
    except ValueError:
        values = []
    if len(values) != len(words) or not all(-LARGEST < v < LARGEST for v in values):
        index, bad = next((i, word) for i, word in enumerate(words, start=1) if not _is_number(word))
        raise FormatError(f"{what}: value {index} is {bad[:20]!r}, expected a finite number", path, line)
    return values


def _is_number(word: str) -> bool:
    try:
        return -LARGEST < float(word) < LARGEST
    except ValueError:
        return False


def ranges_of(words: Sequence[str], what: str, path: Path, line: int) -> list[float]:
    """The words as ranges [m], NaN for a beam without return: what is not finite, or negative.

    Raises `FormatError` naming the first word that is no number.
    """
    try:
        values = list(map(float, words))
    except ValueError:
        values = [_range(word, index, what, path, line) for index, word in enumerate(words, start=1)]
    return [value if 0.0 <= value < math.inf else math.nan for value in values]


def _range(word: str, index: int, what: str, path: Path, line: int) -> float:
    try:
        return math.nan if NOT_FINITE.fullmatch(word.strip()) else float(word)
    except ValueError:
        message = f"{what}: value {index} is {word[:20]!r}, expected metres"
        raise FormatError(message, path, line) from None


def whole(word: str, what: str, path: Path, line: int) -> int:
    """The word as a count. Raises `FormatError` where it is none, or beyond `MOST`."""
    if not (word.isascii() and word.isdecimal() and len(word) <= len(str(MOST))):
        raise FormatError(f"{what} is {word[:20]!r}, expected a whole number", path, line)
    return int(word)


def range_matrix(rows: list[list[float]], lines: list[int], path: Path) -> tuple[Array, np.ndarray]:
    """Ranges ``(N, B)`` [m] from one list per scan, each read in the line of the same index; and which scans
    ``(N,)`` have as many as most: of the others the ranges are NaN.

    Raises `FormatError` when there is no scan, or more than `ODD_SCANS` of them are of another number.
    """
    if not rows:
        raise FormatError("no range scans, expected at least one", path)
    counts = np.array([len(row) for row in rows])
    beams = Counter(counts.tolist()).most_common(1)[0][0]
    kept = counts == beams
    if np.mean(~kept) > ODD_SCANS or beams == 0:
        odd = int(np.argmax(~kept if beams else kept))
        expected = f"{beams} as most scans have" if beams else "at least one"
        raise FormatError(f"scan of {counts[odd]} ranges, expected {expected}", path, lines[odd])
    empty = [np.nan] * beams
    return np.array([row if as_most else empty for row, as_most in zip(rows, kept, strict=True)]), kept


def printable_ranges(ranges: Array, laser: Laser, decimals: int) -> Array:
    """Ranges ``(N, B)`` m to be printed with so many ``decimals``.

    Rounding takes no return out of the laser's limits; NaN becomes the maximum range, which means no return.
    """
    quantum = 10.0**-decimals
    nearest = max(float(np.ceil(laser.range_min / quantum - 1e-9)), 1.0)
    beyond = float(np.ceil(laser.range_max / quantum - 1e-9))
    steps = np.clip(np.round(ranges / quantum), nearest, beyond - 1.0)
    return quantum * np.where(np.isnan(ranges), beyond, steps)


def recording_name(path: Path) -> str:
    """``intel.raw`` for ``intel.raw.log.gz``."""
    name = path.name
    for suffix in (*packed.SUFFIXES, ".log", ".txt", ".npz", ".bag", ".db3", ".mcap"):
        name = name.removesuffix(suffix)
    return name or path.name
