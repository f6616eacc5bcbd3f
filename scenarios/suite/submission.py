"""What somebody hands in: trajectories in a folder or a zip, read into memory and never run or unpacked."""

from __future__ import annotations

import json
import math
import stat
import zipfile
import zlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath
from typing import Any

from slam.cli import InputError, nearest
from slam.formats import FormatError, answer
from slam.formats.text import File
from slam.trajectory import Trajectory

SUFFIXES = (".tum", ".txt", ".square", ".npz", ".log")
"""What a trajectory's file ends with; other files are left alone."""
NOTES = "answers.json"
MAX_FILES = 1000
MAX_TOTAL = 2_000_000_000
"""Bytes that a submission may unpack to."""
TORN = (OSError, EOFError, ValueError, RuntimeError, NotImplementedError, zipfile.BadZipFile, zlib.error)


@dataclass(frozen=True)
class Submission:
    """Trajectories by the recording's name; of each, where it is stated, the wall time [s] and why there is
    none; and the machine."""

    trajectories: dict[str, Trajectory]
    wall_s: dict[str, float] = field(default_factory=dict)
    refused: dict[str, str] = field(default_factory=dict)
    machine: str = ""


def read_submission(path: Path, known: Sequence[str]) -> Submission:
    """The submission in a folder or a zip, of the recordings ``known``.

    Raises `InputError`, one line, for a trajectory that cannot be read or is of no recording of the suite,
    for two of one, and for an archive that is torn, too large, or has paths that leave it.
    """
    trajectories: dict[str, Trajectory] = {}
    notes: dict[str, Any] = {}
    for name, data in _files(path):
        file = File(path / name, data=data)
        where = PurePosixPath(name)
        if where.name == NOTES:
            notes = _notes(file, known)
        elif where.suffix.lower() in SUFFIXES:
            entry = where.stem
            if entry not in known:
                raise InputError(f"{path}: {name!r} is of no recording of the suite: {nearest(entry, known)}")
            if entry in trajectories:
                raise InputError(f"{path}: two answers for {entry}, expected one")
            try:
                trajectories[entry] = answer.read(file)
            except (FormatError, ValueError) as error:
                raise InputError(str(error)) from error
    if not trajectories:
        raise InputError(f"{path}: no answers, expected files as {known[0]}.tum")
    return Submission(trajectories, **notes)


def _files(path: Path) -> Iterator[tuple[str, bytes]]:
    """Path within and content of every file that may be an answer. Raises `InputError`."""
    try:
        if path.is_dir():
            yield from _of_folder(path)
        elif zipfile.is_zipfile(path):
            yield from _of_zip(path)
        elif path.exists():
            raise InputError(f"{path}: expected a folder or a zip of trajectories")
        else:
            raise InputError(f"{path}: no such file or folder")
    except InputError:
        raise
    except TORN as error:
        raise InputError(f"{path}: cannot be read: {error}") from error


def _is_wanted(name: str) -> bool:
    where = PurePosixPath(name)
    return where.name == NOTES or where.suffix.lower() in SUFFIXES


def _of_folder(folder: Path) -> Iterator[tuple[str, bytes]]:
    """The files of a folder; links that lead out of it are refused."""
    root = folder.resolve()
    found = sorted(file for file in folder.rglob("*") if file.is_file())
    _check_size(folder, len(found), [file.stat().st_size for file in found])
    for file in found:
        name = file.relative_to(folder).as_posix()
        if not file.resolve().is_relative_to(root):
            raise InputError(f"{folder}: {name!r} leads out of the folder, expected files in it")
        if _is_wanted(name):
            yield name, file.read_bytes()


def _of_zip(path: Path) -> Iterator[tuple[str, bytes]]:
    """The files of an archive, none of which is written anywhere."""
    with zipfile.ZipFile(path) as archive:
        entries = [entry for entry in archive.infolist() if not entry.is_dir()]
        for entry in entries:
            parts = PurePosixPath(entry.filename.replace("\\", "/"))
            if parts.is_absolute() or ".." in parts.parts or ":" in entry.filename:
                raise InputError(f"{path}: {entry.filename!r} leaves the folder, expected paths within it")
            if stat.S_ISLNK(entry.external_attr >> 16):
                raise InputError(f"{path}: {entry.filename!r} is a link, expected files")
            if entry.flag_bits & 1:
                raise InputError(f"{path}: {entry.filename!r} is encrypted, expected it without a password")
        _check_size(path, len(entries), [entry.file_size for entry in entries])
        for entry in entries:
            if _is_wanted(entry.filename):
                with archive.open(entry) as file:
                    yield entry.filename, file.read(answer.MAX_BYTES + 1)[: answer.MAX_BYTES]


def _check_size(path: Path, count: int, sizes: Sequence[int]) -> None:
    """Raises `InputError` for more or larger files than a submission has."""
    if count > MAX_FILES:
        raise InputError(f"{path}: {count} files, expected at most {MAX_FILES}")
    largest = max(sizes, default=0)
    if largest > answer.MAX_BYTES:
        raise InputError(f"{path}: a file of {largest:,} bytes, expected at most {answer.MAX_BYTES:,}")
    if sum(sizes) > MAX_TOTAL:
        raise InputError(f"{path}: {sum(sizes):,} bytes, expected at most {MAX_TOTAL:,}")


def _notes(file: File, known: Sequence[str]) -> dict[str, Any]:
    """What answers.json states. Raises `InputError`."""
    expected = '{"wall_s": {"RECORDING": 1.5}, "refused": {"RECORDING": "why"}, "machine": "what"}'
    try:
        content = json.loads(file.text)
        cost = {name: float(value) for name, value in content.get("wall_s", {}).items()}
        refused = {name: " ".join(str(why).split())[:200] for name, why in content.get("refused", {}).items()}
        machine = str(content.get("machine", ""))[:200]
    except (ValueError, TypeError, AttributeError, OverflowError, RecursionError) as error:
        raise InputError(f"{file.path}: {error}, expected {expected}") from error
    for name in (*cost, *refused):
        if name not in known:
            raise InputError(f"{file.path}: {name!r} is no recording of the suite: {nearest(name, known)}")
    if not all(math.isfinite(value) and value >= 0.0 for value in cost.values()):
        raise InputError(f"{file.path}: wall_s expected in seconds, 0 or more")
    return {"wall_s": cost, "refused": refused, "machine": machine}
