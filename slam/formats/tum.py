"""Trajectories as TUM files, ``stamp tx ty tz qx qy qz qw`` per line, which evo reads.

Behind them there may be a covariance of the pose in its body tangent (right perturbation): the 21 entries of
the lower triangle of 6 × 6, row by row, in the order (x, y, z, roll, pitch, yaw), as smfeval reads it; or the
6 of 3 × 3 in the order (x, y, yaw).
"""

from __future__ import annotations

from os import PathLike
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from slam.formats.text import File, FormatError, numbers
from slam.se2 import Array
from slam.trajectory import Trajectory

COLUMNS = "stamp tx ty tz qx qy qz qw"
POSE = len(COLUMNS.split())
SPATIAL, PLANAR = 21, 6
"""Entries of the lower triangle of a covariance in space, and in the plane."""
IN_PLANE = (0, 1, 5)
"""Rows of x, y and yaw among those of (x, y, z, roll, pitch, yaw)."""
OFF_PLANE = 1e-6
"""Variance [m², rad²] written for height, roll and pitch, of which a robot in the plane says nothing: a
matrix of zeros would be no covariance."""


def write(
    path: str | PathLike[str], time: ArrayLike, poses: ArrayLike, covariance: ArrayLike | None = None
) -> None:
    """Write stamps ``(N,)`` s and poses ``(N, 3)``, every digit, in the order given; with ``covariance (N, 3,
    3)`` also the 21 entries of each.

    Raises ``ValueError`` when their lengths differ.
    """
    stamps, table = np.asarray(time, dtype=np.float64), np.asarray(poses, dtype=np.float64)
    if table.shape != (len(stamps), 3):
        raise ValueError(f"trajectory: expected poses of shape ({len(stamps)}, 3), got {table.shape}")
    Path(path).write_text(f"# {COLUMNS}\n" + lines(stamps, table, covariance), encoding="utf-8")


def lines(stamps: Array, poses: Array, covariance: ArrayLike | None = None) -> str:
    """The lines of a file. Raises ``ValueError`` where there is not one covariance for each pose."""
    behind = [""] * len(stamps)
    if covariance is not None:
        sigma = np.asarray(covariance, dtype=np.float64)
        if sigma.shape != (len(stamps), 3, 3):
            raise ValueError(f"trajectory: expected covariances ({len(stamps)}, 3, 3), got {sigma.shape}")
        behind = [" " + " ".join(map(repr, row)) for row in _in_space(sigma)[:, *_triangle(6)].tolist()]
    rows = []
    for stamp, (x, y, yaw), more in zip(stamps.tolist(), poses.tolist(), behind, strict=True):
        qz, qw = float(np.sin(0.5 * yaw)), float(np.cos(0.5 * yaw))
        rows.append(f"{stamp!r} {x!r} {y!r} 0.0 0.0 0.0 {qz!r} {qw!r}{more}\n")
    return "".join(rows)


def read(path: str | PathLike[str]) -> tuple[Array, Array]:
    """Stamps ``(N,)`` s and poses ``(N, 3)``: the projection to the plane, yaw in [-π, π].

    Raises `FormatError` naming file and line.
    """
    found = read_trajectory(path)
    return found.time, found.poses


def read_trajectory(source: File | str | PathLike[str]) -> Trajectory:
    """Poses and, where every line has it, their covariance, in the plane; yaw in [-π, π].

    Raises `FormatError` naming file and line.
    """
    file, rows = File.of(source), list[list[float]]()
    for number, words in file.records():
        if len(words) not in (POSE, POSE + PLANAR, POSE + SPATIAL):
            expected = f"{POSE}: {COLUMNS}; or {PLANAR} or {SPATIAL} more, of a covariance"
            raise FormatError(f"pose of {len(words)} values, expected {expected}", file.path, number)
        if rows and len(words) != len(rows[0]):
            message = f"pose of {len(words)} values, expected {len(rows[0])} as in the lines before"
            raise FormatError(message, file.path, number)
        row = numbers(words, "pose", file.path, number)
        if not any(row[4:POSE]):
            raise FormatError("quaternion is zero, expected a rotation", file.path, number)
        rows.append(row)
    if not rows:
        raise FormatError(f"no poses, expected lines of {COLUMNS}", file.path)
    table = np.array(rows)
    stamp, x, y, _, qx, qy, qz, qw = table[:, :POSE].T
    yaw = np.arctan2(2.0 * (qw * qz + qx * qy), qw**2 + qx**2 - qy**2 - qz**2)
    return Trajectory(stamp, np.stack([x, y, yaw], -1), _covariance(table[:, POSE:]))


def _covariance(triangles: Array) -> Array | None:
    """Matrices ``(N, 3, 3)`` of lower triangles ``(N, 6)``, or of ``(N, 21)`` those of x, y and yaw."""
    size = {0: 0, PLANAR: 3, SPATIAL: 6}[triangles.shape[1]]
    if size == 0:
        return None
    rows, columns = _triangle(size)
    sigma = np.zeros((len(triangles), size, size))
    sigma[:, rows, columns] = sigma[:, columns, rows] = triangles
    return sigma if size == 3 else sigma[:, IN_PLANE][:, :, IN_PLANE]


def _in_space(sigma: Array) -> Array:
    """Covariances ``(N, 6, 6)`` of a robot that stays in the plane."""
    space = np.tile(np.diag([0.0, 0.0, OFF_PLANE, OFF_PLANE, OFF_PLANE, 0.0]), (len(sigma), 1, 1))
    space[np.ix_(range(len(sigma)), IN_PLANE, IN_PLANE)] = sigma
    return space


def _triangle(size: int) -> tuple[np.ndarray, np.ndarray]:
    """Rows and columns of a lower triangle, row by row."""
    return np.tril_indices(size)
