"""Occupancy maps as ROS's map_server keeps them: an image and a yaml beside it.

A pixel of shade p means an occupancy of (255 - p)/255, or p/255 with ``negate``: above ``occupied_thresh``
occupied, below ``free_thresh`` free, between them unknown. The shade is the mean of the pixel's channels; in
the mode ``trinary`` alpha is one of them, in the mode ``scale`` whatever is not opaque is unknown: so
map_server has it. The image's top row is the map's largest y.
"""

from __future__ import annotations

import math
import re
from dataclasses import replace
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from slam.formats.text import File, FormatError
from slam.mapping.occupancy import Grid
from slam.se2 import Array

OCCUPIED, FREE, UNKNOWN = 0, 254, 205
OCCUPIED_THRESH, FREE_THRESH = 0.65, 0.196
"""map_server's own thresholds: 205 lies just between them."""
MAX_PIXELS = 100_000_000
"""Larger images are refused, before they are decoded."""
FARTHEST = 1e8
"""Metres that an origin may be away: maps in geographic coordinates are nearer."""
BYTES_PER_PIXEL = 5
"""What reading takes: the file, the pixels, their shade, and two cells."""
PNG_MAGIC = b"\x89PNG\r\n\x1a\n"
_GAP = rb"(?:\s|#[^\n]*\n)+"
PNM_HEADER = re.compile(rb"P[2356]" + _GAP + _GAP.join([rb"(\d{1,9})"] * 3) + rb"\s")
"""Of pgm and ppm: width, height and the value that is white."""


def write(path: str | PathLike[str], grid: Grid, yaw: float = 0.0) -> None:
    """Write ``NAME.yaml`` and ``NAME.pgm`` beside it, for ``path`` NAME.yaml.

    With ``yaw`` rad the grid's rows are turned about its ``origin``. Raises ``ValueError`` for another
    suffix.
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
        f"origin: [{x!r}, {y!r}, {float(yaw)!r}]\n"
        "negate: 0\n"
        f"occupied_thresh: {OCCUPIED_THRESH}\n"
        f"free_thresh: {FREE_THRESH}\n",
        encoding="utf-8",
    )


def read(path: str | PathLike[str]) -> Grid:
    """Read a map from its yaml, in the map's frame.

    Raises `FormatError` as `read_cells` does, and for a map whose origin is rotated: its cells are not along
    the axes.
    """
    grid, T_map_grid = read_cells(path)
    if T_map_grid[2] != 0.0:
        raise FormatError(f"origin is rotated by {T_map_grid[2]:g} rad, expected a yaw of 0", path)
    return replace(grid, origin=T_map_grid[:2])


def read_cells(path: str | PathLike[str]) -> tuple[Grid, Array]:
    """Read a map from its yaml, in the frame of the image's lower left corner, and that corner's pose
    ``(3,)`` in the map's frame; the image, pgm or png, is looked for beside the yaml.

    Raises `FormatError` for a yaml without its image, for keys missing or out of range, and for an image that
    is torn or has more than `MAX_PIXELS`.
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
    mode = entries.get("mode", "trinary")
    if mode not in ("trinary", "scale"):
        raise FormatError(f"mode {mode!r}, expected trinary or scale", path)
    negate = _number(entries, "negate", path)
    T_map_grid = _origin(entries, path)
    shade, levels, opaque = _shades(_pixels(_image(entries, path))[::-1], mode)
    occupancy = np.arange(levels + 1) / levels if negate else (levels - np.arange(levels + 1)) / levels
    occupied, free = (occupancy > occupied_thresh)[shade], (occupancy < free_thresh)[shade]
    return Grid(occupied & opaque, free & opaque, np.zeros(2), resolution), T_map_grid


def _shades(pixels: np.ndarray, mode: str) -> tuple[np.ndarray, int, np.ndarray | bool]:
    """Sum over the channels of every pixel, the largest there can be, and which pixels count."""
    most = int(np.iinfo(pixels.dtype).max)
    if pixels.ndim == 2:
        return pixels, most, True
    opaque: np.ndarray | bool = True
    if pixels.shape[2] == 4 and mode == "scale":
        opaque, pixels = pixels[..., 3] == most, pixels[..., :3]
    return pixels.sum(axis=2, dtype=np.uint32), most * pixels.shape[2], opaque


def _entries(path: Path) -> dict[str, Any]:
    import yaml

    try:
        entries = yaml.safe_load(File(path).text)
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        line = None if mark is None else mark.line + 1
        raise FormatError(f"not yaml: {getattr(error, 'problem', error)}", path, line) from None
    except RecursionError:
        raise FormatError("nested too deeply, expected the keys of a map_server map", path) from None
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


def _origin(entries: dict[str, Any], path: Path) -> Array:
    origin = _entry(entries, "origin", path)
    if not isinstance(origin, list) or len(origin) != 3:
        raise FormatError(f"origin is {origin!r}, expected [x, y, yaw]", path)
    pose = np.array([_number({"origin": value}, "origin", path) for value in origin])
    if np.max(np.abs(pose[:2])) > FARTHEST:
        raise FormatError(f"origin is {origin!r}, expected metres within ±{FARTHEST:g}", path)
    return pose


def image_of(path: str | PathLike[str]) -> Path:
    """The image a yaml names. Raises `FormatError` where there is none."""
    return _image(_entries(Path(path)), Path(path))


def _image(entries: dict[str, Any], path: Path) -> Path:
    name = _entry(entries, "image", path)
    if not isinstance(name, str) or not (path.parent / name).is_file():
        raise FormatError(f"image {name} not found beside the yaml", path)
    return path.parent / name


def _pixels(image: Path) -> np.ndarray:
    """Pixels ``(H, W)`` or ``(H, W, channels)`` as they are in the file, top row first."""
    import cv2

    with image.open("rb") as file:
        width, height = _size(file.read(4096), image)
    if width * height > MAX_PIXELS:
        need = BYTES_PER_PIXEL * width * height / 1e9
        message = f"{width} x {height} pixels would take {need:.1f} GB of memory"
        raise FormatError(f"{message}, expected at most {MAX_PIXELS:,} pixels", image)
    data = np.fromfile(image, dtype=np.uint8)
    logging = cv2.utils.logging
    level = logging.setLogLevel(logging.LOG_LEVEL_SILENT)  # a torn image is told in our own one line
    try:
        pixels = cv2.imdecode(data, cv2.IMREAD_UNCHANGED)
    finally:
        logging.setLogLevel(level)
    if pixels is None:
        raise FormatError("not an image, expected pgm or png", image)
    return np.asarray(pixels)


def _size(head: bytes, image: Path) -> tuple[int, int]:
    """Width and height from the first bytes of an image."""
    if head.startswith(PNG_MAGIC) and len(head) >= 24:
        return int.from_bytes(head[16:20], "big"), int.from_bytes(head[20:24], "big")
    header = PNM_HEADER.match(head)
    if header is None:
        raise FormatError("not an image, expected pgm or png", image)
    if int(header[3]) not in (255, 65535):
        raise FormatError(f"white is {int(header[3])}, expected 255 or 65535", image)
    return int(header[1]), int(header[2])


def _quoted(name: str) -> str:
    return "'" + name.replace("'", "''") + "'"
