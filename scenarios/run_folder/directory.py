"""The directory of a run: written under a temporary name beside its place, renamed when complete."""

from __future__ import annotations

import errno
import glob
import hashlib
import json
import os
import re
import shutil
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import count
from os import PathLike
from pathlib import Path

from scenarios.jsonable import dump
from slam.cli import InputError

CONFIG_FILE = "config.json"
METRICS_FILE = "metrics.json"
"""A folder that holds this is a run, and may be replaced by a newer one."""
DISK_ERRORS = (errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EIO)
"""Errors of a file system that accepted the folder and then cannot take more."""


@dataclass(frozen=True)
class Folder:
    """Where a run is being written, and where it will be found."""

    temporary: Path
    final: Path


def fingerprint(target: str | PathLike[str]) -> str:
    """What tells a recording from all others: a digest of its file, or of the files in its folder; of a map
    that is named by its yaml, of the image beside it too. Raises `InputError` for a file that cannot be
    read."""
    path = Path(target)
    if path.suffix in (".yaml", ".yml"):
        files = list(path.parent.glob(f"{glob.escape(path.stem)}.*"))
    else:
        files = list(path.rglob("*")) if path.is_dir() else [path]
    whole = hashlib.sha256()
    try:
        for part in sorted(file for file in files if file.is_file()):
            with part.open("rb") as content:
                whole.update(hashlib.file_digest(content, "sha256").digest())
    except OSError as error:
        raise InputError(f"{target}: cannot be read: {error.strerror}") from error
    return whole.hexdigest()


def vacant_name(out: Path, name: str, recording: str) -> str:
    """``name``, or ``name-2``, ``-3``…: the first under which ``out`` has no run of another recording.

    Recordings are told apart by their `fingerprint`; a run that does not tell its own may be replaced.
    """
    for number in count(1):
        candidate = name if number == 1 else f"{name}-{number}"
        if _recording_of(out / safe_name(candidate)) in ("", recording):
            return candidate
    raise AssertionError  # count never ends


def _recording_of(run: Path) -> str:
    """The fingerprint that a run's config.json tells, or nothing."""
    try:
        return str(json.loads((run / CONFIG_FILE).read_text(encoding="utf-8"))["fingerprint"])
    except (OSError, ValueError, LookupError, TypeError, RecursionError):
        return ""


def safe_name(name: str) -> str:
    """``name`` with every character replaced that some file system does not allow in a file name."""
    return re.sub(r"[^A-Za-z0-9._-]+", "_", name).strip("._") or "unnamed"


def check(out: Path, name: str) -> None:
    """Check that the run's folder can be put into ``out``; creates nothing. Raises `InputError`."""
    existing = next(folder for folder in (out, *out.absolute().parents) if os.path.lexists(folder))
    if not existing.is_dir():
        raise InputError(f"--out {out}: {existing} is not a folder")
    if not os.access(existing, os.W_OK | os.X_OK):
        raise InputError(f"--out {out}: {existing} cannot be written")
    final = out / safe_name(name)
    if os.path.lexists(final) and not (final / METRICS_FILE).is_file():
        raise InputError(f"--out {out}: {final} is in the way and not a run's folder")


@contextmanager
def prepare(out: Path, name: str) -> Iterator[Folder]:
    """A temporary folder in ``out``, which is created where it is missing; removed again when the run fails.
    Raises `InputError` where the file system cannot be written."""
    created = [folder for folder in (out, *out.parents) if not folder.exists()]
    began = False
    try:
        out.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix=".unfinished-", dir=out) as temporary:
            began = True
            yield Folder(Path(temporary), out / safe_name(name))
    except OSError as error:
        if began and error.errno not in DISK_ERRORS:
            raise
        raise InputError(f"--out {out}: cannot be written: {error.strerror}") from error
    finally:
        for folder in created:
            if folder.is_dir() and not any(folder.iterdir()):
                folder.rmdir()


def publish(folder: Folder, environment: Mapping[str, object]) -> None:
    """Write environment.json, give the folder its final name and let the link ``latest`` point at it in one
    step; a file or folder of that name that is no link stays."""
    dump(folder.temporary / "environment.json", environment)
    folder.temporary.chmod(0o755)
    replaced = folder.temporary.with_name(f"{folder.temporary.name}-replaced")
    if folder.final.exists():
        folder.final.rename(replaced)
    folder.temporary.rename(folder.final)
    if replaced.exists():
        shutil.rmtree(replaced)
    latest = folder.final.parent / "latest"
    if latest.is_symlink() or not latest.exists():
        link = folder.final.parent / f".latest-{folder.final.name}"
        link.unlink(missing_ok=True)
        link.symlink_to(folder.final.name, target_is_directory=True)
        link.replace(latest)
