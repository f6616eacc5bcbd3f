"""Where a run is put: written to a temporary folder beside its place, renamed when complete."""

from __future__ import annotations

import errno
import os
import re
import shutil
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from scenarios.jsonable import dump
from slam.cli import InputError

MARK = "metrics.json"
"""A folder that holds this is a run, and may be replaced by a newer one."""
FULL = (errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EIO)
"""What a file system says that takes no more, though it took the folder."""


@dataclass(frozen=True)
class Folder:
    """Where a run is being written, and where it will be found."""

    temporary: Path
    final: Path


def safe(name: str) -> str:
    """A name that is one plain file name on every system."""
    return re.sub(r"[^A-Za-z0-9._-]+", "_", name).strip("._") or "unnamed"


def check(out: Path, name: str) -> None:
    """See that the run's folder can be put into ``out``, without touching anything. Raises `InputError`."""
    there = next(folder for folder in (out, *out.absolute().parents) if os.path.lexists(folder))
    if not there.is_dir():
        raise InputError(f"--out {out}: {there} is not a folder")
    if not os.access(there, os.W_OK | os.X_OK):
        raise InputError(f"--out {out}: {there} cannot be written")
    final = out / safe(name)
    if os.path.lexists(final) and not (final / MARK).is_file():
        raise InputError(f"--out {out}: {final} is in the way and not a run's folder")


@contextmanager
def prepare(out: Path, name: str) -> Iterator[Folder]:
    """A temporary folder in ``out``, which is made where it is missing; all of it is gone when the run fails.

    Raises `InputError` when the file system does not let us write.
    """
    made = [folder for folder in (out, *out.parents) if not folder.exists()]
    temporary = None
    try:
        out.mkdir(parents=True, exist_ok=True)
        temporary = Path(tempfile.mkdtemp(prefix=".unfinished-", dir=out))
        yield Folder(temporary, out / safe(name))
    except OSError as error:
        if temporary is not None and error.errno not in FULL:
            raise
        raise InputError(f"--out {out}: cannot be written: {error.strerror}") from error
    finally:
        if temporary is not None and temporary.exists():
            shutil.rmtree(temporary)
        for folder in made:
            if folder.is_dir() and not any(folder.iterdir()):
                folder.rmdir()


def publish(folder: Folder, environment: Mapping[str, object]) -> None:
    """Note what made the run, give the folder its name and let ``latest`` point at it."""
    dump(folder.temporary / "environment.json", environment)
    folder.temporary.chmod(0o755)
    replaced = folder.temporary.with_name(f"{folder.temporary.name}-replaced")
    if folder.final.exists():
        folder.final.rename(replaced)
    folder.temporary.rename(folder.final)
    if replaced.exists():
        shutil.rmtree(replaced)
    _point_at(folder.final)


def _point_at(final: Path) -> None:
    """Move the link ``latest``, in one step; a file or folder that somebody else called so stays."""
    latest = final.parent / "latest"
    if latest.is_symlink() or not latest.exists():
        link = final.parent / f".latest-{final.name}"
        link.unlink(missing_ok=True)
        link.symlink_to(final.name, target_is_directory=True)
        link.replace(latest)
