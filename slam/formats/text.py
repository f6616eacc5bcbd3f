"""Files read once, their lines and numbers, and what is wrong with them in one line."""

from __future__ import annotations

import gzip
import zlib
from collections.abc import Iterator, Sequence
from functools import cached_property
from os import PathLike
from pathlib import Path

import numpy as np

from slam.recording import Laser
from slam.se2 import Array

GZIP_MAGIC = b"\x1f\x8b"


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

    Of a ROS bag the user may name the laser's ``topic`` and the ``odometry``.
    """

    def __init__(
        self, path: str | PathLike[str], data: bytes | None = None, topic: str = "", odometry: str = ""
    ) -> None:
        self.path = Path(path)
        self.topic, self.odometry = topic, odometry
        if data is not None:
            self.__dict__["data"] = data

    @classmethod
    def of(cls, source: File | str | PathLike[str]) -> File:
        """The file at a path, or the one given."""
        return source if isinstance(source, File) else cls(source)

    @cached_property
    def data(self) -> bytes:
        """The bytes, unpacked where they are gzipped.

        Raises `FormatError` for a file that is missing, unreadable, a directory, empty, or a torn gzip.
        """
        return _read_bytes(self.path)

    @cached_property
    def text(self) -> str:
        """The text with ``\\n`` line ends. Raises `FormatError` where it is binary, or as `data` does."""
        nul = self.data.find(b"\0")
        if nul >= 0:
            line = self.data.count(b"\n", 0, nul) + 1
            raise FormatError("binary data, expected text", self.path, line)
        return self.data.decode("utf-8", errors="replace").replace("\r\n", "\n")

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
    if data.startswith(GZIP_MAGIC):
        try:
            data = gzip.decompress(data)
        except (EOFError, zlib.error, gzip.BadGzipFile) as error:
            raise FormatError(f"torn gzip file ({error}), expected a complete one", path) from None
    if not data.strip():
        raise FormatError("the file is empty", path)
    return data


def numbers(words: Sequence[str], what: str, path: Path, line: int) -> list[float]:
    """The words as floats. Raises `FormatError` naming the first that is none, or is not finite."""
    try:
        values = list(map(float, words))
    except ValueError:
        values = []
    if len(values) != len(words) or not np.isfinite(values).all():
        index, bad = next((i, word) for i, word in enumerate(words) if not _is_finite(word))
        raise FormatError(f"{what}: value {index + 1} is {bad[:20]!r}, expected a finite number", path, line)
    return values


def _is_finite(word: str) -> bool:
    try:
        return bool(np.isfinite(float(word)))
    except ValueError:
        return False


def range_matrix(rows: list[list[float]], lines: list[int], path: Path) -> Array:
    """Ranges ``(N, B)`` [m] from one list per scan, each read in the line of the same index.

    Raises `FormatError` when there is no scan, the number of beams changes, or a range is negative.
    """
    if not rows or not rows[0]:
        raise FormatError("no range scans, expected at least one", path)
    beams = len(rows[0])
    for row, line in zip(rows, lines, strict=True):
        if len(row) != beams:
            raise FormatError(f"scan of {len(row)} ranges, expected {beams} as in the first scan", path, line)
    ranges = np.array(rows)
    if (ranges < 0.0).any():
        scan, beam = np.argwhere(ranges < 0.0)[0]
        message = f"range {beam + 1} is {ranges[scan, beam]:g}, expected metres >= 0"
        raise FormatError(message, path, lines[scan])
    return ranges


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
    for suffix in (".gz", ".log", ".txt", ".npz", ".db3", ".mcap", ".bag"):
        name = name.removesuffix(suffix)
    return name or path.name
