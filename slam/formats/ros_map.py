"""Occupancy maps as ROS's map_server keeps them: an image and a yaml beside it.

A pixel of shade p, the mean of its colours, means an occupancy of (255 - p)/255, or p/255 with ``negate``:
above ``occupied_thresh`` occupied, below ``free_thresh`` free, between them unknown. In the mode ``raw`` p is
the occupancy in per cent, and what is above 100 is unknown. What is not opaque is unknown. The image's top
row is the map's largest y.

map_saver writes three greys: black, 205 for unknown, white. nav2's own ``free_thresh`` of 0.25 lies on the
wrong side of 205, so a picture of these greys is read as map_saver means it, whatever its thresholds are.
"""

from __future__ import annotations

import math
import reprlib
from dataclasses import dataclass, replace
from os import PathLike
from pathlib import Path, PureWindowsPath
from typing import Any

import numpy as np

from slam.formats import map_image
from slam.formats.text import File, FormatError
from slam.mapping.occupancy import Grid
from slam.se2 import Array

OCCUPIED, FREE, UNKNOWN = 0, 254, 205
OCCUPIED_THRESH, FREE_THRESH = 0.65, 0.196
"""map_server's own thresholds: 205 lies just between them."""
MODES = ("trinary", "scale", "raw")
FARTHEST = 1e8
"""Metres that an origin may be away: maps in geographic coordinates are nearer."""
GREY_TOLERANCE = 4.0 / 255.0
"""Editors and converters move the saver's greys by so much lightness: 206 is its unknown too."""
MIN_GREY_SHARE = 0.9
"""Share of the pixels with one of the saver's greys from which a picture is taken for the saver's; jpg blurs
the others."""
NEARER_TO_FREE = 1.0 - 0.5 * (FREE + UNKNOWN) / 255.0
"""Occupancy below which a shade of such a picture is nearer to the saver's free than to its unknown."""


@dataclass(frozen=True)
class RosMap:
    """A map's ``grid`` in the frame of the image's lower left corner, that corner's pose ``T_map_grid (3,)``
    in the map's frame, and the file of its ``image``; ``notes``: what a user should know, a line each."""

    grid: Grid
    T_map_grid: Array
    image: Path
    notes: tuple[str, ...] = ()

    @property
    def states_unknown(self) -> bool:
        """Whether any cell is unknown: where none is, free means no more than not drawn."""
        return not bool(np.all(self.grid.occupied | self.grid.free))


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

    Raises `FormatError` as `read_map` does, and for a map whose origin is rotated: its cells are not along
    the axes.
    """
    found = read_map(path)
    if found.T_map_grid[2] != 0.0:
        raise FormatError(f"origin is rotated by {found.T_map_grid[2]:g} rad, expected a yaw of 0", path)
    return replace(found.grid, origin=found.T_map_grid[:2])


def read_map(path: str | PathLike[str]) -> RosMap:
    """Read a map from its yaml and the image that it names.

    Raises `FormatError` for a yaml without its image, for keys missing or out of range, and for an image that
    `slam.formats.map_image.read` refuses.
    """
    path = Path(path)
    entries = _entries(path)
    resolution = _number(entries, "resolution", path)
    if not resolution > 0.0:
        raise FormatError(f"resolution {resolution:g}, expected metres per pixel > 0", path)
    thresholds = _thresholds(entries, path)
    mode = str(entries.get("mode") or MODES[0]).strip().lower()
    if mode not in MODES:
        raise FormatError(f"mode {reprlib.repr(mode)}, expected {', '.join(MODES)}", path)
    negate, T_map_grid = _flag(entries, "negate", path), _origin(entries, path)
    file, notes = _image(entries, path)
    occupied, free = _cells(map_image.read(file), mode, negate, thresholds)
    grid = Grid(
        np.ascontiguousarray(occupied[::-1]), np.ascontiguousarray(free[::-1]), np.zeros(2), resolution
    )
    found = RosMap(grid, T_map_grid, file, tuple(notes))
    if found.states_unknown:
        return found
    note = f"{path}: no cell is unknown, so its free space is no evidence of what was seen"
    return replace(found, notes=(*notes, note))


def _cells(
    image: map_image.MapImage, mode: str, negate: bool, thresholds: tuple[float, float]
) -> tuple[np.ndarray, np.ndarray]:
    """Which pixels ``(H, W)`` are occupied, and which free."""
    occupied_thresh, free_thresh = thresholds
    lightness = np.arange(image.white + 1) / image.white
    if mode == "raw":
        percent = np.round(255.0 * lightness)
        occupancy = np.where(percent <= 100.0, 0.01 * percent, np.nan)  # NaN is neither
    else:
        occupancy = lightness if negate else 1.0 - lightness
        if _by_map_saver(image, occupancy):
            free_thresh = min(free_thresh, NEARER_TO_FREE)
    occupied, free = (occupancy > occupied_thresh)[image.shade], (occupancy < free_thresh)[image.shade]
    return (occupied, free) if image.opaque is None else (occupied & image.opaque, free & image.opaque)


def _by_map_saver(image: map_image.MapImage, occupancy: Array) -> bool:
    """Whether the shades, of this ``occupancy (S,)`` each, are map_saver's, its unknown among them."""
    opaque = image.shade if image.opaque is None else image.shade[image.opaque]
    count = np.bincount(opaque.ravel(), minlength=len(occupancy))
    greys = np.array([OCCUPIED, UNKNOWN, 0.5 * (FREE + 255)]) / 255.0
    near = np.abs(1.0 - occupancy[:, None] - greys) <= GREY_TOLERANCE
    of_greys = count @ near
    return bool(of_greys[1] > 0 and of_greys.sum() >= MIN_GREY_SHARE * count.sum())


def _entries(path: Path) -> dict[str, Any]:
    """The yaml's entries, every scalar as text: nothing in it is built that we do not ask for."""
    import yaml

    loader = getattr(yaml, "CBaseLoader", yaml.BaseLoader)  # libyaml's own, where it is there, never hangs
    try:
        entries = yaml.load(File(path).text, Loader=loader)
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
    if entries.get(key) in (None, "", "~", "null"):
        raise FormatError(f"no {key}, expected image, resolution, origin, negate and thresholds", path)
    return entries[key]


def _number(entries: dict[str, Any], key: str, path: Path) -> float:
    value = _entry(entries, key, path)
    try:
        number = float(value)
    except (TypeError, ValueError):
        number = math.nan
    if not math.isfinite(number):
        raise FormatError(f"{key} is {reprlib.repr(value)}, expected a number", path)
    return number


def _flag(entries: dict[str, Any], key: str, path: Path) -> bool:
    value = str(_entry(entries, key, path)).lower()
    if value in ("true", "yes", "on", "false", "no", "off"):
        return value in ("true", "yes", "on")
    return _number(entries, key, path) != 0.0


def _thresholds(entries: dict[str, Any], path: Path) -> tuple[float, float]:
    occupied, free = (_number(entries, key, path) for key in ("occupied_thresh", "free_thresh"))
    if not 0.0 <= free <= occupied <= 1.0:
        message = f"free_thresh {free:g}, occupied_thresh {occupied:g}"
        raise FormatError(f"{message}, expected 0 <= free_thresh <= occupied_thresh <= 1", path)
    return occupied, free


def _origin(entries: dict[str, Any], path: Path) -> Array:
    origin = _entry(entries, "origin", path)
    shown = reprlib.repr(origin).replace("'", "") if isinstance(origin, list) else reprlib.repr(origin)
    if not isinstance(origin, list) or len(origin) != 3:
        raise FormatError(f"origin is {shown}, expected [x, y, yaw]", path)
    pose = np.array([_number({"origin": value}, "origin", path) for value in origin])
    if np.max(np.abs(pose[:2])) > FARTHEST:
        raise FormatError(f"origin is {shown}, expected metres within ±{FARTHEST:g}", path)
    return pose


def image_of(path: str | PathLike[str]) -> Path:
    """The image a yaml names. Raises `FormatError` where there is none."""
    return _image(_entries(Path(path)), Path(path))[0]


def _image(entries: dict[str, Any], path: Path) -> tuple[Path, list[str]]:
    """The image a yaml names, or, where that is another computer's path, the one so called beside the yaml;
    and a note about that."""
    name = entries.get("image")
    if not name or not isinstance(name, str):
        raise FormatError(f"no image, expected the name of one, got {reprlib.repr(name)}", path)
    own = PureWindowsPath(name).name  # after the last slash of either kind
    try:
        if (path.parent / name).is_file():
            return path.parent / name, []
        beside = [f for f in path.parent.iterdir() if f.name.lower() == own.lower() and f.is_file()]
    except OSError as error:
        raise FormatError(f"image {reprlib.repr(name)}: {error.strerror}", path) from None
    if not beside:
        raise FormatError(f"image {name} not found beside the yaml", path)
    image = min(beside, key=lambda file: (file.name != own, file.name))
    return image, [f"{path}: image {name} is not there, {image.name} beside the yaml is used"]


def _quoted(name: str) -> str:
    return "'" + name.replace("'", "''") + "'"
