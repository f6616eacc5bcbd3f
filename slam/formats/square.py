"""SQUARE files, version 0.3, as smfeval reads and writes them: TUM with a header that states its conventions.

A line ``#%KEY value`` each; ``gaussian_se3`` rows have the 21 entries of a covariance, ``deterministic`` ones
none, ``ensemble_se3`` holds particles. (svendbot/smfeval, SQUARE_spec.md.)
"""

from __future__ import annotations

import re
from dataclasses import replace
from os import PathLike
from pathlib import Path

import numpy as np

from slam import se2
from slam.formats import tum
from slam.formats.text import File, FormatError
from slam.trajectory import Body, Trajectory

FIELD = re.compile(r"^#%\s*(\w+)[ \t]*(.*?)\s*$", re.MULTILINE)
VERSION = "SQUARE/0.3"
EXPECTED = {
    "REPRESENTATION": ("gaussian_se3", "deterministic"),
    "TIMESTAMP_UNIT": ("seconds",),
    "GAUGE": ("fixed", "se3", "gravity_yaw"),
}
"""Header fields that every file needs → the values that can be scored."""
OF_GAUSSIAN = {
    "TANGENT_CONVENTION": ("right_perturbation", "left_perturbation"),
    "TANGENT_ORDER": ("translation_rotation", "rotation_translation"),
    "ROTATION_PARAM": ("axis_angle",),
}
"""Those that only files with covariances need."""
LASERS = ("laser", "lidar", "laser_frame", "laser_link", "base_laser", "base_scan", "scan")
"""Names of bodies that are the laser; any other is the robot."""
SWAPPED = np.array([3, 4, 5, 0, 1, 2])


def recognise(file: File) -> bool:
    """Whether a header states the format."""
    return re.search(r"^#%\s*FORMAT\s+SQUARE/", file.text[:10_000], re.MULTILINE) is not None


def read(source: File | str | PathLike[str]) -> Trajectory:
    """The poses and their covariances in the plane, as right perturbations in the order (x, y, yaw).

    Raises `FormatError` for a header that does not state its conventions, or others than can be scored.
    """
    file = File.of(source)
    header = {key.upper(): value for key, value in FIELD.findall(file.text)}
    if not header.get("FORMAT", "").startswith("SQUARE/0."):
        raise FormatError(f"FORMAT is {header.get('FORMAT', 'missing')!r}, expected {VERSION}", file.path)
    gaussian = header.get("REPRESENTATION") == "gaussian_se3"
    for key, values in (EXPECTED | (OF_GAUSSIAN if gaussian else {})).items():
        if header.get(key) not in values:
            stated = repr(header[key][:40]) if key in header else "not stated"
            raise FormatError(f"{key} is {stated}, expected {' or '.join(values)}", file.path)
    body: Body = "laser" if header.get("BODY_FRAME", "").lower() in LASERS else "robot"
    if gaussian and header["TANGENT_ORDER"] == "rotation_translation":
        file = File(file.path, data=_reordered(file).encode())
    found = replace(tum.read_trajectory(file), body=body)
    if gaussian != (found.covariance is not None):
        columns = 29 if gaussian else 8
        raise FormatError(
            f"{header['REPRESENTATION']} rows are of {columns} values, these are not", file.path
        )
    if found.covariance is not None and header["TANGENT_CONVENTION"] == "left_perturbation":
        sigma = se2.transport(found.covariance, se2.inverse(found.poses))
        return replace(found, covariance=0.5 * (sigma + np.swapaxes(sigma, 1, 2)))
    return found


def _reordered(file: File) -> str:
    """The rows with covariances in the order translation, rotation."""
    size = tum.POSE + tum.SPATIAL
    place = np.zeros((6, 6), dtype=int)
    rows, columns = np.tril_indices(6)
    place[rows, columns] = place[columns, rows] = np.arange(tum.SPATIAL)
    order = tum.POSE + place[np.ix_(SWAPPED, SWAPPED)][rows, columns]
    text = []
    for number, words in file.records():
        if len(words) != size:
            raise FormatError(f"pose of {len(words)} values, expected {size}", file.path, number)
        text.append(" ".join([*words[: tum.POSE], *(words[k] for k in order)]))
    return "\n".join(text)


def write(path: str | PathLike[str], found: Trajectory, algorithm: str, version: str) -> None:
    """Write what `read` and smfeval read. Line ends within names become spaces."""
    gaussian = found.covariance is not None
    header = {
        "FORMAT": VERSION,
        "REPRESENTATION": "gaussian_se3" if gaussian else "deterministic",
        "POSE_FRAME": "world",
        "BODY_FRAME": "laser" if found.body == "laser" else "base_link",
        "GAUGE": "se3",
        "TIMESTAMP_UNIT": "seconds",
        "ALGORITHM": algorithm,
        "ALGORITHM_VERSION": version,
    }
    if gaussian:
        header |= {key: values[0] for key, values in OF_GAUSSIAN.items()}
    text = "".join(f"#%{key} {' '.join(value.split())}\n" for key, value in header.items())
    rows = tum.lines(found.time, found.poses, found.covariance)
    Path(path).write_text(text + rows, encoding="utf-8")
