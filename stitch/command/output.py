"""The files of a merged map: NAME.yaml, NAME.pgm and NAME.png."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterable
from pathlib import Path

from slam.cli import InputError
from slam.formats import ros_map
from slam.mapping.occupancy import Grid

SUFFIXES = (".yaml", ".pgm", ".png")


def paths(out: Path) -> list[Path]:
    """The files, in the order of `SUFFIXES`; ``out`` may be named after one of them."""
    stem = out.name.removesuffix(out.suffix) if out.suffix in SUFFIXES else out.name
    return [out.with_name(stem + suffix) for suffix in SUFFIXES]


def check(out: Path) -> None:
    """See that the files can be written, without touching anything. Raises `InputError`."""
    if not out.name or out.is_dir():
        raise InputError(f"--out {out}: is a folder, expected the name of a map, as in {out / 'merged'}")
    there = next(folder for folder in out.absolute().parents if os.path.lexists(folder))
    if not there.is_dir():
        raise InputError(f"--out {out}: {there} is not a folder")
    if not os.access(there, os.W_OK | os.X_OK):
        raise InputError(f"--out {out}: {there} cannot be written")


def check_inputs(out: Path, maps: Iterable[Path]) -> None:
    """See that no map would be overwritten. Raises `InputError`."""
    written = {path.resolve() for path in paths(out)}
    for path in maps:
        for file in (path, ros_map.image_of(path)):
            if file.resolve() in written:
                raise InputError(f"--out {out}: would overwrite {file}, expected another name")


def write(out: Path, grid: Grid, yaw: float, picture: bytes) -> list[Path]:
    """Write all files or none, in a folder that is made where it is missing; returns their paths.

    ``yaw`` rad turns the grid's rows about its origin. Raises `InputError` when the file system does not let
    us write.
    """
    finals = paths(out)
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix=".unfinished-", dir=out.parent) as folder:
            temporary = [Path(folder) / path.name for path in finals]
            ros_map.write(temporary[0], grid, yaw)
            temporary[2].write_bytes(picture)
            for source, final in zip(temporary, finals, strict=True):
                source.replace(final)
    except OSError as error:
        raise InputError(f"--out {out}: cannot be written: {error.strerror}") from error
    return finals
