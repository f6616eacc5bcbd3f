"""Trajectories as TUM files, ``stamp tx ty tz qx qy qz qw`` per line, which evo reads."""

from __future__ import annotations

from os import PathLike
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from slam.formats.text import File, FormatError
from slam.se2 import Array

COLUMNS = "stamp tx ty tz qx qy qz qw"


def write(path: str | PathLike[str], time: ArrayLike, poses: ArrayLike) -> None:
    """Write stamps ``(N,)`` s and poses ``(N, 3)``, every digit, in the order given.

    Raises ``ValueError`` when their lengths differ.
    """
    stamps, table = np.asarray(time, dtype=np.float64), np.asarray(poses, dtype=np.float64)
    if table.shape != (len(stamps), 3):
        raise ValueError(f"trajectory: expected poses of shape ({len(stamps)}, 3), got {table.shape}")
    lines = [f"# {COLUMNS}\n"]
    for stamp, (x, y, yaw) in zip(stamps.tolist(), table.tolist(), strict=True):
        qz, qw = float(np.sin(0.5 * yaw)), float(np.cos(0.5 * yaw))
        lines.append(f"{stamp!r} {x!r} {y!r} 0.0 0.0 0.0 {qz!r} {qw!r}\n")
    Path(path).write_text("".join(lines), encoding="utf-8")


def read(path: str | PathLike[str]) -> tuple[Array, Array]:
    """Stamps ``(N,)`` s and poses ``(N, 3)``: the projection to the plane, yaw in [-π, π].

    Raises `FormatError` naming file and line.
    """
    rows = []
    for number, row in File(path).rows("pose", COLUMNS):
        if not any(row[4:]):
            raise FormatError("quaternion is zero, expected a rotation", path, number)
        rows.append(row)
    if not rows:
        raise FormatError(f"no poses, expected lines of {COLUMNS}", path)
    stamp, x, y, _, qx, qy, qz, qw = np.array(rows).T
    yaw = np.arctan2(2.0 * (qw * qz + qx * qy), qw**2 + qx**2 - qy**2 - qz**2)
    return stamp, np.stack([x, y, yaw], -1)
