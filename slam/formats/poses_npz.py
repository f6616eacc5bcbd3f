"""Poses as an npz: ``time (N,)`` s, ``poses (N, 3)`` m, m, rad, and perhaps ``covariance (N, 3, 3)``."""

from __future__ import annotations

import io
from os import PathLike
from zipfile import ZipFile

import numpy as np

from slam import se2
from slam.formats.recording_npz import TORN
from slam.formats.text import File, FormatError
from slam.trajectory import Trajectory

NEEDED = ("time", "poses")
LARGEST_ARRAY = 200_000_000
"""Bytes to which an array may unpack."""


def recognise(file: File) -> bool:
    """Whether it is an archive of arrays."""
    return file.data.startswith(b"PK\x03\x04")


def read(source: File | str | PathLike[str]) -> Trajectory:
    """Read the arrays, of which nothing is unpickled. Raises `FormatError`."""
    file = File.of(source)
    arrays = _load(file)
    absent = [name for name in NEEDED if name not in arrays]
    if absent:
        raise FormatError(f"no array {absent[0]!r}, expected time (N,) and poses (N, 3)", file.path)
    try:
        found = Trajectory(arrays["time"], arrays["poses"], arrays.get("covariance"))
    except (ValueError, TypeError) as error:
        raise FormatError(str(error), file.path) from None
    poses = np.column_stack([found.poses[:, :2], se2.wrap(found.poses[:, 2])])
    return Trajectory(found.time, poses, found.covariance)


def _load(file: File) -> dict[str, np.ndarray]:
    names = (*NEEDED, "covariance")
    try:
        with ZipFile(io.BytesIO(file.data)) as archive:
            largest = max((entry.file_size for entry in archive.infolist()), default=0)
        if largest > LARGEST_ARRAY:
            message = f"an array of {largest:,} bytes, expected at most {LARGEST_ARRAY:,}"
            raise FormatError(message, file.path)
        with np.load(io.BytesIO(file.data), allow_pickle=False) as archive:
            return {name: archive[name] for name in names if name in archive.files}
    except TORN as error:
        if isinstance(error, FormatError):
            raise
        raise FormatError(f"torn or foreign npz ({error}), expected time and poses", file.path) from None
