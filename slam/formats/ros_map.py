"""Occupancy maps as ROS's map_server keeps them: an image and a yaml beside it.

A pixel p means an occupancy of (255 - p)/255, or p/255 with ``negate``: above ``occupied_thresh`` occupied,
below ``free_thresh`` free, between them unknown. The image's top row is the map's largest y.
"""

from __future__ import annotations

import math
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from slam.formats.errors import FormatError
from slam.formats.text import decode, read_bytes
from slam.occupancy import Grid

OCCUPIED, FREE, UNKNOWN = 0, 254, 205
OCCUPIED_THRESH, FREE_THRESH = 0.65, 0.196
"""map_server's own thresholds: 205 lies just between them."""


def write(path: str | PathLike[str], grid: Grid) -> None:
    """Write ``NAME.yaml`` and ``NAME.pgm`` beside it, for ``path`` NAME.yaml.

    Raises ``ValueError`` for another suffix.
    """
    path = Path(path)
    if path.suffix != ".yaml":
        raise ValueError(f"{path}: a map is named after its yaml file, expected NAME.yaml")
    pixels = np.full(grid.occupied.shape, UNKNOWN, dtype=np.uint8)
    pixels[grid.free] = FREE
    pixels[grid.occupied] = OCCUPIED
    height, width = grid.occupied.shape
    image = path.with_suffix(".pgm")
    image.write_bytes(b"P5\n%d %d\n255\n" % (width, height) + pixels[::-1].tobytes())
    x, y = (float(value) for value in grid.origin)
    path.write_text(
        f"image: {_quoted(image.name)}\n"
        f"resolution: {float(grid.resolution)!r}\n"
        f"origin: [{x!r}, {y!r}, 0.0]\n"
        "negate: 0\n"
        f"occupied_thresh: {OCCUPIED_THRESH}\n"
        f"free_thresh: {FREE_THRESH}\n",
        encoding="utf-8",
    )


def read(path: str | PathLike[str]) -> Grid:
    """Read a map from its yaml; the image, pgm or png, is looked for beside it.

    Raises `FormatError` for a yaml without its image, for keys missing or out of range, and for a map whose
    origin is rotated.
    """
    path = Path(path)
    entries = _entries(path)
    resolution = _number(entries, "resolution", path)
    if not resolution > 0.0:
        raise FormatError(f"resolution {resolution:g}, expected metres per pixel > 0", path)
    occupied_thresh = _number(entries, "occupied_thresh", path)
    free_thresh = _number(entries, "free_thresh", path)
    if not 0.0 <= free_thresh <= occupied_thresh <= 1.0:
        message = f"free_thresh {free_thresh:g}, occupied_thresh {occupied_thresh:g}"
        raise FormatError(f"{message}, expected 0 <= free_thresh <= occupied_thresh <= 1", path)
    if entries.get("mode", "trinary") != "trinary":
        raise FormatError(f"mode {entries['mode']!r}, expected trinary", path)
    negate = _number(entries, "negate", path)
    origin = _origin(entries, path)
    image = path.parent / str(_entry(entries, "image", path))
    pixels = _pixels(image, path)[::-1].astype(np.float64)
    occupancy = pixels / 255.0 if negate else (255.0 - pixels) / 255.0
    return Grid(occupancy > occupied_thresh, occupancy < free_thresh, origin, resolution)


def _entries(path: Path) -> dict[str, Any]:
    import yaml

    try:
        entries = yaml.safe_load(decode(read_bytes(path), path))
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        line = None if mark is None else mark.line + 1
        raise FormatError(f"not yaml: {getattr(error, 'problem', error)}", path, line) from None
    if not isinstance(entries, dict):
        raise FormatError("not a map, expected yaml with image, resolution and origin", path)
    return entries


def _entry(entries: dict[str, Any], key: str, path: Path) -> Any:
    if entries.get(key) is None:
        raise FormatError(f"no {key}, expected the keys of a map_server map", path)
    return entries[key]


def _number(entries: dict[str, Any], key: str, path: Path) -> float:
    value = _entry(entries, key, path)
    try:
        number = float(value)  # yaml 1.1 takes 1e-05, without a point, for a string
    except (TypeError, ValueError):
        number = math.nan
    if not math.isfinite(number):
        raise FormatError(f"{key} is {value!r}, expected a number", path)
    return number


def _origin(entries: dict[str, Any], path: Path) -> np.ndarray:
    origin = _entry(entries, "origin", path)
    if not isinstance(origin, list) or len(origin) != 3:
        raise FormatError(f"origin is {origin!r}, expected [x, y, yaw]", path)
    x, y, yaw = (_number({"origin": value}, "origin", path) for value in origin)
    if yaw != 0.0:
        raise FormatError(f"origin is rotated by {yaw:g} rad, expected a yaw of 0", path)
    return np.array([x, y])


def _pixels(image: Path, path: Path) -> np.ndarray:
    """Grey values ``(H, W)``, top row first."""
    import cv2

    if not image.is_file():
        raise FormatError(f"image {image.name} not found beside the yaml", path)
    data = np.fromfile(image, dtype=np.uint8)
    logging = cv2.utils.logging
    level = logging.setLogLevel(logging.LOG_LEVEL_SILENT)  # a torn image is told in our own one line
    try:
        pixels = cv2.imdecode(data, cv2.IMREAD_GRAYSCALE) if data.size else None
    finally:
        logging.setLogLevel(level)
    if pixels is None:
        raise FormatError("not an image, expected pgm or png", image)
    return np.asarray(pixels)


def _quoted(name: str) -> str:
    return "'" + name.replace("'", "''") + "'"
