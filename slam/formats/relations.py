"""Relative poses known to be true, as published with the SLAM benchmark of Kümmerle et al. 2009."""

from __future__ import annotations

from os import PathLike
from pathlib import Path

import numpy as np

from slam.formats.text import File, FormatError
from slam.recording import Relations

COLUMNS = "t1 t2 x y z roll pitch yaw"


def write(path: str | PathLike[str], relations: Relations) -> None:
    """Write what `read` reads, with six decimals."""
    rows = zip(relations.stamps.tolist(), relations.T_12.tolist(), strict=True)
    lines = [
        f"{t1:.6f} {t2:.6f} {x:.6f} {y:.6f} 0.000000 0.000000 0.000000 {yaw:.6f}\n"
        for (t1, t2), (x, y, yaw) in rows
    ]
    Path(path).write_text("".join(lines), encoding="utf-8")


def read(path: str | PathLike[str]) -> Relations:
    """Read lines ``t1 t2 x y z roll pitch yaw`` [s, m, rad]: the pose at t2 in the frame of the pose at t1.

    z, roll and pitch are dropped. Raises `FormatError` naming file and line.
    """
    rows = [row for _, row in File(path).rows("relation", COLUMNS)]
    if not rows:
        raise FormatError(f"no relations, expected lines of {COLUMNS}", path)
    table = np.array(rows)
    return Relations(stamps=table[:, :2], T_12=table[:, [2, 3, 7]])
