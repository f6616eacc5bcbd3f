"""Another system's answer for a log: lines ``stamp x y theta …``, one per scan, in the order of the log."""

from __future__ import annotations

from os import PathLike
from pathlib import Path

import numpy as np

from slam import se2
from slam.formats.errors import FormatError
from slam.formats.text import decode, numbers, read_bytes
from slam.se2 import Array

COLUMNS = "stamp x y theta"


def read(path: str | PathLike[str], scans: int) -> Array:
    """Poses ``(N, 3)`` (m, m, rad), one for each of the recording's ``scans``; further columns are dropped.

    Raises `FormatError` naming file and line, and when the number of poses differs from that of the scans.
    """
    path, rows = Path(path), []
    for number, line in enumerate(decode(read_bytes(path), path).split("\n"), start=1):
        words = line.split()
        if not words or words[0].startswith("#"):
            continue
        if len(words) < 4:
            raise FormatError(f"pose of {len(words)} values, expected at least 4: {COLUMNS}", path, number)
        rows.append(numbers(words[:4], "pose", path, number))
    if len(rows) != scans:
        raise FormatError(f"{len(rows)} poses, expected one for each of {scans} scans", path)
    poses = np.array(rows)[:, 1:]
    poses[:, 2] = se2.wrap(poses[:, 2])
    return poses
