"""What a system answered for a drive, in whichever of the formats of trajectories."""

from __future__ import annotations

from collections.abc import Callable
from os import PathLike
from pathlib import Path

from slam.formats import carmen, peer, poses_npz, square, tum
from slam.formats.text import File, FormatError
from slam.trajectory import Trajectory

MAX_BYTES = 200_000_000
"""A larger file is no trajectory of a drive; it is refused before it is read."""
READERS: tuple[tuple[Callable[[File], bool], Callable[[File], Trajectory]], ...] = (
    (poses_npz.recognise, poses_npz.read),
    (square.recognise, square.read),
    (carmen.recognise, carmen.read_trajectory),
)
"""What tells a format, and its reader; a plain table of numbers is none of these."""


def read(source: File | str | PathLike[str]) -> Trajectory:
    """Poses by their stamps, of a TUM file (with covariances or without), a SQUARE file, a corrected CARMEN
    log, an npz, or lines ``stamp x y theta``; told apart by content.

    Raises `FormatError`, one line, for what cannot be read, and for a file beyond `MAX_BYTES`.
    """
    file = File.of(source)
    if not isinstance(source, File):
        check_size(file.path)
    for recognise, reader in READERS:
        if recognise(file):
            return reader(file)
    words = next((words for _, words in file.records()), [])
    if len(words) < tum.POSE:
        return peer.read_trajectory(file)
    return tum.read_trajectory(file)


def check_size(path: Path) -> None:
    """Raises `FormatError` for a file beyond `MAX_BYTES`."""
    size = path.stat().st_size if path.is_file() else 0
    if size > MAX_BYTES:
        raise FormatError(f"{size:,} bytes, expected a trajectory of at most {MAX_BYTES:,}", path)
