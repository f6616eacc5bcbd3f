"""Another system's trajectory for a log: lines ``stamp x y theta …``, one per scan, in its order."""

from __future__ import annotations

from os import PathLike

import numpy as np

from slam import se2
from slam.formats.text import File, FormatError
from slam.se2 import Array

COLUMNS = "stamp x y theta"


def read(path: str | PathLike[str], scans: int) -> Array:
    """Poses ``(N, 3)`` (m, m, rad), one for each of the recording's ``scans``; further columns are dropped.

    Raises `FormatError` naming file and line, and when the number of poses differs from that of the scans.
    """
    rows = [row for _, row in File(path).rows("pose", COLUMNS, more=True)]
    if len(rows) != scans:
        raise FormatError(f"{len(rows)} poses, expected one for each of {scans} scans", path)
    poses = np.array(rows)[:, 1:]
    poses[:, 2] = se2.wrap(poses[:, 2])
    return poses
