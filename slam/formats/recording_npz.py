"""Recordings as ``recording.npz``: plain arrays, no pickles, the same recording giving the same bytes."""

from __future__ import annotations

import io
import zipfile
import zlib
from os import PathLike
from pathlib import Path

import numpy as np

from slam.formats.text import File, FormatError
from slam.recording import Laser, Odometry, Recording, Relations

SCHEMA = 1
ZIP_MAGIC = b"PK\x03\x04"
EPOCH = (1980, 1, 1, 0, 0, 0)
"""The earliest date a zip entry can have; a real one would change the bytes from run to run."""
TORN = (ValueError, OSError, EOFError, KeyError, RuntimeError, zipfile.BadZipFile, zlib.error)
"""What numpy and zipfile raise for damaged files (``RuntimeError``: encryption, unknown compression)."""
REQUIRED = (
    "schema",
    "name",
    "time",
    "ranges",
    "angles",
    "dead_reckoning",
    "source",
    "laser_limits",
    "T_robot_laser",
)
OPTIONAL = (
    "mount_source",
    "mount_stated",
    "attitude",
    "truth",
    "odometry_time",
    "odometry_poses",
    "scan_row",
    "relation_stamps",
    "relation_T_12",
    "corruptions",
)


def write(path: str | PathLike[str], recording: Recording) -> None:
    """Write everything a recording holds; ``numpy.load(path, allow_pickle=False)`` reads it too."""
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, array in _arrays(recording).items():
            buffer = io.BytesIO()
            np.lib.format.write_array(buffer, np.asarray(array), allow_pickle=False)
            entry = zipfile.ZipInfo(f"{name}.npy", date_time=EPOCH)
            entry.compress_type = zipfile.ZIP_DEFLATED
            entry.create_system = 3  # the same on every platform
            archive.writestr(entry, buffer.getvalue())


def recognise(file: File) -> bool:
    """Whether it is a zip file."""
    return file.data.startswith(ZIP_MAGIC)


def read(source: File | str | PathLike[str]) -> Recording:
    """Read what `write` wrote. Raises `FormatError` naming the file."""
    file = File.of(source)
    path = file.path
    arrays = _load(file.data, path)
    missing = [name for name in REQUIRED if name not in arrays]
    if missing:
        raise FormatError(f"no array {missing[0]!r}, expected a recording.npz", path)
    unknown = [name for name in arrays if name not in REQUIRED + OPTIONAL]
    if unknown:
        raise FormatError(f"unknown array {unknown[0][:40]!r}, expected a recording.npz", path)
    if arrays["schema"].shape != () or int(arrays["schema"]) != SCHEMA:
        raise FormatError(f"schema {arrays['schema']}, expected {SCHEMA}", path)
    try:
        return _recording(arrays)
    except (ValueError, TypeError, KeyError) as error:
        raise FormatError(f"not a valid recording: {error}", path) from None


def _arrays(recording: Recording) -> dict[str, object]:
    laser = recording.laser
    arrays: dict[str, object] = {
        "schema": SCHEMA,
        "name": recording.name,
        "time": recording.time,
        "ranges": recording.ranges,
        "angles": recording.angles,
        "dead_reckoning": recording.dead_reckoning,
        "source": recording.source,
        "laser_limits": np.array([laser.range_min, laser.range_max, laser.sigma_range]),
        "T_robot_laser": laser.T_robot_laser,
        "attitude": recording.attitude,
        "truth": recording.truth,
        "mount_source": laser.mount_source or None,
        "corruptions": recording.corruptions or None,
    }
    if recording.odometry is not None:
        arrays["odometry_time"] = recording.odometry.time
        arrays["odometry_poses"] = recording.odometry.poses
        arrays["scan_row"] = recording.odometry.scan_row
    if recording.relations is not None:
        arrays["relation_stamps"] = recording.relations.stamps
        arrays["relation_T_12"] = recording.relations.T_12
    return {name: array for name, array in arrays.items() if array is not None}


def _load(data: bytes, path: Path) -> dict[str, np.ndarray]:
    try:
        with np.load(io.BytesIO(data), allow_pickle=False) as archive:
            return {name: archive[name] for name in archive.files}
    except TORN as error:
        raise FormatError(f"torn or foreign npz ({error}), expected a recording.npz", path) from None


def _recording(arrays: dict[str, np.ndarray]) -> Recording:
    low, high, sigma = arrays["laser_limits"].tolist()
    odometry = relations = None
    mount_source = str(arrays.get("mount_source", "stated" if "mount_stated" in arrays else ""))
    if "odometry_time" in arrays:
        odometry = Odometry(arrays["odometry_time"], arrays["odometry_poses"], arrays["scan_row"])
    if "relation_stamps" in arrays:
        relations = Relations(arrays["relation_stamps"], arrays["relation_T_12"])
    return Recording(
        name=str(arrays["name"]),
        time=arrays["time"],
        ranges=arrays["ranges"],
        angles=arrays["angles"],
        laser=Laser(low, high, sigma, arrays["T_robot_laser"], mount_source),
        dead_reckoning=arrays["dead_reckoning"],
        source=str(arrays["source"]),  # type: ignore[arg-type]  # checked by Recording
        odometry=odometry,
        attitude=arrays.get("attitude"),
        truth=arrays.get("truth"),
        relations=relations,
        corruptions=tuple(map(str, np.ravel(arrays.get("corruptions", ())))),
    )
