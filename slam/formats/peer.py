"""Another system's answer for a log: rows ``stamp x y theta …``, one per scan, in the order of the log."""

from __future__ import annotations

from os import PathLike
from pathlib import Path

import numpy as np

from slam import se2
from slam.formats.errors import FormatError
from slam.formats.text import decode, read_bytes
from slam.se2 import Array


def read(path: str | PathLike[str], scans: int) -> Array:
    """Poses ``(N, 3)`` (m, m, rad), one for each of the recording's ``scans``.

    Raises `FormatError` when a row has not four finite numbers or the number of rows differs from that of scans.
    """
    path, rows = Path(path), []
    for number, line in enumerate(decode(read_bytes(path), path).splitlines(), start=1):
        if not line.strip() or line.startswith("#"):
            continue
        try:
            values = [float(word) for word in line.split()[1:4]]
        except ValueError:
            values = []
        if len(values) != 3 or not np.all(np.isfinite(values)):
            raise FormatError("expected 'stamp x y theta', finite numbers", path, number)
        rows.append(values)
    if len(rows) != scans:
        raise FormatError(f"expected one pose for each of {scans} scans, got {len(rows)}", path)
    poses = np.array(rows)
    poses[:, 2] = se2.wrap(poses[:, 2])
    return poses
