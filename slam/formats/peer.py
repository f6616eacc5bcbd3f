"""Another system's trajectory for a log: lines ``stamp x y theta …``."""

from __future__ import annotations

from os import PathLike

import numpy as np

from slam import se2
from slam.formats.text import File, FormatError
from slam.se2 import Array
from slam.trajectory import Trajectory

COLUMNS = "stamp x y theta"


def read(path: str | PathLike[str], scans: int) -> Array:
    """Poses ``(N, 3)`` (m, m, rad), one for each of the recording's ``scans``.

    Raises `FormatError` naming file and line, and when the number of poses differs from that of the scans.
    """
    found = read_trajectory(path)
    if len(found) != scans:
        raise FormatError(f"{len(found)} poses, expected one for each of {scans} scans", path)
    return found.poses


def read_trajectory(source: File | str | PathLike[str]) -> Trajectory:
    """Poses (m, m, rad) and their stamps; further columns are dropped. Raises `FormatError` naming file and
    line."""
    file = File.of(source)
    rows = np.array([row for _, row in file.rows("pose", COLUMNS, more=True)])
    if len(rows) == 0:
        raise FormatError(f"no poses, expected lines of {COLUMNS}", file.path)
    return Trajectory(rows[:, 0], np.column_stack([rows[:, 1:3], se2.wrap(rows[:, 3])]))
