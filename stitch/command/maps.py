"""ROS maps as submaps, read and written; alignments in their frames and in their anchors', and how they are
told: an object for JSON, lines to read."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from slam import se2
from slam.cli import InputError
from slam.formats import FormatError, ros_map
from slam.mapping.occupancy import Grid
from slam.mapping.submap import Submap
from slam.se2 import Array
from stitch.alignment.config import AlignConfig, TolerantConfig
from stitch.alignment.result import Alternative, NoStitch, Prior, Stitch

SUFFIXES = (".yaml", ".pgm", ".png")
MIN_WALLS = 10
"""Occupied cells below which there is nothing to align."""
MAX_SEARCH = 25_000_000
"""Cells that a search may have: two maps side by side, turned as they may be."""
BYTES_PER_SEARCH_CELL = 60


def read_submap(path: Path) -> tuple[Submap, tuple[str, ...]]:
    """The map as a submap whose anchor is the image's lower left corner, in the map's frame; and what the
    user should know of it, a line each.

    Cells beyond those that are known are cut off. In a map without unknown cells, as a floor plan is, free
    means not drawn: nothing there was seen, so it neither speaks against a wall nor for an overlap, and only
    the walls are kept. Raises `FormatError` for a map that cannot be read or has
    hardly any wall.
    """
    from stitch.alignment.walls import surfaces

    found = ros_map.read_map(path)
    grid = found.grid if found.states_unknown else replace(found.grid, free=np.zeros_like(found.grid.free))
    walls = int(grid.occupied.sum())
    if walls < MIN_WALLS:
        height, width = grid.occupied.shape
        message = f"{walls} occupied of {width} x {height} cells, expected at least {MIN_WALLS} to align"
        raise FormatError(message, path)
    known = cropped(grid)
    return Submap(0, 1, found.T_map_grid, surfaces(known), known), found.notes


def settings_for(submaps: Sequence[Submap], method: str = "joint", scale: bool = False) -> AlignConfig:
    """The settings of a method for maps that may be bent, the second perhaps of another ``scale``; a raster
    is never finer than the maps are."""
    coarsest = max(submap.grid.resolution for submap in submaps)
    default = AlignConfig()
    return AlignConfig(
        method=method,
        resolution=max(default.resolution, coarsest),
        search=replace(default.search, resolution=max(default.search.resolution, coarsest)),
        tolerant=TolerantConfig(enabled=True, free_scale=scale),
    )


def check_size(submaps: Sequence[Submap], config: AlignConfig) -> None:
    """See that any two of the maps can be aligned in memory. Raises `FormatError`."""
    sides = np.array([submap.grid.occupied.shape for submap in submaps]) * np.array(
        [[submap.grid.resolution] for submap in submaps]
    )
    longest = np.max(np.hypot(*sides.T))  # of a map turned by any angle
    cells = float(np.max(np.prod((sides + longest) / config.search.resolution, axis=1)))
    if not cells <= MAX_SEARCH:
        need, most = (BYTES_PER_SEARCH_CELL * count / 1e9 for count in (cells, MAX_SEARCH))
        size = ", ".join(f"{width:.0f} x {height:.0f} m" for height, width in sides)
        raise FormatError(
            f"maps of {size}: aligning takes {need:.1f} GB of memory, expected at most {most:.1f}"
        )


def cropped(grid: Grid) -> Grid:
    """The smallest part of a grid that holds all its known cells."""
    known = grid.occupied | grid.free
    (top, bottom), (left, right) = (np.flatnonzero(known.any(axis=axis))[[0, -1]] + (0, 1) for axis in (1, 0))
    part = np.s_[top:bottom, left:right]
    origin = grid.origin + np.array([left, top]) * grid.resolution
    occupied, free = (np.ascontiguousarray(cells[part]) for cells in (grid.occupied, grid.free))
    return Grid(occupied, free, origin, grid.resolution)


def prior_between(a: Submap, b: Submap, T_a_b: Array, sigma: Array) -> Prior:
    """A guess ``T_a_b (3,)`` of map b in the frame of map a, as a prior between their anchors.

    ``sigma (3,)`` m, m, rad are the standard deviations of its numbers. Raises ``ValueError`` where one is
    not positive or not finite.
    """
    if not (np.all(sigma > 0.0) and np.all(np.isfinite(sigma))):
        raise ValueError(f"expected three standard deviations > 0, got {' '.join(f'{s:g}' for s in sigma)}")
    covariance = se2.to_body_covariance(T_a_b, np.diag(sigma**2))
    T = se2.compose(se2.between(a.anchor, T_a_b), b.anchor)
    return Prior(T, se2.transport(covariance, se2.inverse(b.anchor)))


def between_maps(a: Submap, b: Submap, result: Stitch | NoStitch) -> Stitch | NoStitch:
    """An alignment between the anchors of two submaps as one between their maps."""
    others = tuple(_moved(a, b, alternative) for alternative in result.alternatives)
    if isinstance(result, NoStitch):
        return replace(result, best=result.best and _moved(a, b, result.best), alternatives=others)
    return replace(_moved(a, b, result), alternatives=others)


def pose_between_maps(a: Submap, b: Submap, T: Array, scale: float = 1.0) -> Array:
    """Pose ``T (3,)`` of the anchor of b seen from that of a, as one of their maps, b enlarged by
    ``scale``."""
    return se2.compose(se2.compose(a.anchor, T), se2.inverse(_anchor(b, scale)))


def _anchor(submap: Submap, scale: float) -> Array:
    """The anchor ``(3,)`` in the frame of a map that is enlarged by ``scale``."""
    anchor: Array = submap.anchor * np.array([scale, scale, 1.0])
    return anchor


Answer = TypeVar("Answer", Stitch, Alternative)


def _moved(a: Submap, b: Submap, answer: Answer) -> Answer:
    """An answer between anchors as one between maps."""
    anchor, bend = _anchor(b, answer.scale), answer.bend
    return replace(
        answer,
        T_a_b=pose_between_maps(a, b, answer.T_a_b, answer.scale),
        covariance=None if answer.covariance is None else se2.transport(answer.covariance, anchor),
        bend=None if bend is None else bend.between_maps(a.anchor, anchor),
    )


def deviations(T_a_b: Array, covariance: Array) -> Array:
    """Standard deviations ``(3,)`` of a pose's x, y and yaw, from its body covariance ``(3, 3)``."""
    R = np.eye(3)
    R[:2, :2] = se2.rotation(T_a_b[2])
    return np.sqrt(np.diag(R @ covariance @ R.T))


def output_paths(out: Path) -> list[Path]:
    """The files NAME.yaml, NAME.pgm and NAME.png of a merged map; ``out`` may be named after one of them."""
    stem = out.name.removesuffix(out.suffix) if out.suffix in SUFFIXES else out.name
    return [out.with_name(stem + suffix) for suffix in SUFFIXES]


def check_output(out: Path) -> None:
    """See that the files can be written, without touching anything. Raises `InputError`."""
    if not out.name or out.is_dir():
        raise InputError(f"--out {out}: is a folder, expected the name of a map, as in {out / 'merged'}")
    there = next(folder for folder in out.absolute().parents if os.path.lexists(folder))
    if not there.is_dir():
        raise InputError(f"--out {out}: {there} is not a folder")
    if not os.access(there, os.W_OK | os.X_OK):
        raise InputError(f"--out {out}: {there} cannot be written")


def check_inputs(out: Path, maps: Iterable[Path]) -> None:
    """See that no map would be overwritten. Raises `InputError`."""
    written = {path.resolve() for path in output_paths(out)}
    for path in maps:
        for file in (path, ros_map.image_of(path)):
            if file.resolve() in written:
                raise InputError(f"--out {out}: would overwrite {file}, expected another name")


def write_map(out: Path, grid: Grid, yaw: float, picture: bytes) -> list[Path]:
    """Write all files or none, in a folder that is made where it is missing; returns their paths.

    ``yaw`` rad turns the grid's rows about its origin. Raises `InputError` when the file system does not let
    us write.
    """
    finals = output_paths(out)
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix=".unfinished-", dir=out.parent) as folder:
            temporary = [Path(folder) / path.name for path in finals]
            ros_map.write(temporary[0], grid, yaw)
            temporary[2].write_bytes(picture)
            for source, final in zip(temporary, finals, strict=True):
                source.replace(final)
    except OSError as error:
        raise InputError(f"--out {out}: cannot be written: {error.strerror}") from error
    return finals


def write_picture(path: Path, picture: bytes) -> None:
    """Write a picture. Raises `InputError` when the file system does not let us."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(picture)
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {error.strerror}") from error


def as_json(result: Stitch | NoStitch) -> dict[str, Any]:
    """An alignment of two maps in m, m² and rad; ``null`` is what there is none of.

    ``std`` are the standard deviations of the three numbers of ``T_a_b``; ``belief`` is the probability that
    they are right at all, as of simulated pairs like these; of a bent answer it orders answers, and is not
    calibrated. ``alternatives`` are the other candidates, best
    first; of a refusal all of them are, the best one too. Map b is enlarged by ``scale`` first. ``bend`` is
    how it is bent then: knots in its frame, and where the bend takes them beyond ``T_a_b`` (x and y m, yaw
    rad, in the frame of a); between them it is bilinear in the poses.
    """
    content: dict[str, Any] = {"accepted": isinstance(result, Stitch)}
    content |= dict.fromkeys(("T_a_b", "std", "overlap_m2", "agreement", "margin", "reason"))
    bend, scale = None, None
    if isinstance(result, NoStitch):
        content["reason"], belief = result.reason, None
        others = [] if result.best is None else [result.best, *result.alternatives]
    else:
        bend, scale = _bend_json(result), float(result.scale)
        others, belief = list(result.alternatives), result.belief
        content["T_a_b"] = result.T_a_b.tolist()
        if result.covariance is not None:
            content["std"] = deviations(result.T_a_b, result.covariance).tolist()
        content["overlap_m2"], content["agreement"] = result.overlap_area, result.agreement
        content["margin"] = margin(result)
    content["alternatives"] = [_alternative_json(other) for other in others]
    content["belief"] = None if belief is None else as_probability(belief)
    return content | {"scale": scale, "bend": bend}


def _alternative_json(other: Alternative) -> dict[str, Any]:
    """A candidate; how sure it is where that was worked out."""
    content: dict[str, Any] = {"T_a_b": other.T_a_b.tolist(), "score": other.score}
    if other.covariance is not None:
        content["std"] = deviations(other.T_a_b, other.covariance).tolist()
    if other.belief is not None:
        content["belief"] = as_probability(other.belief)
    return content


def _bend_json(stitch: Stitch) -> dict[str, Any] | None:
    """The field of a bend at its knots."""
    if stitch.bend is None:
        return None
    return {
        "largest_displacement_m": stitch.bend.largest_displacement(stitch.T_a_b),
        "spacing_m": stitch.bend.spacing,
        "knots": stitch.bend.places.reshape(-1, 2).tolist(),
        "displacements": stitch.bend.displacements(stitch.T_a_b).reshape(-1, 3).tolist(),
    }


def as_probability(log_odds: float) -> float:
    """The probability with some log-odds."""
    return float(1.0 / (1.0 + np.exp(-log_odds)))


def margin(stitch: Stitch) -> float | None:
    """What the runner-up lacks of the best score, as a share of it; None without a runner-up."""
    if not stitch.alternatives or not stitch.score > 0.0:
        return None
    return 1.0 - stitch.alternatives[0].score / stitch.score


def in_words(T_a_b: Array) -> str:
    """A pose in one line, in m and degrees."""
    return f"x {T_a_b[0]:.3f} m, y {T_a_b[1]:.3f} m, yaw {np.degrees(T_a_b[2]):.2f}°"


def as_text(stitch: Stitch, a: str, b: str) -> str:
    """The stitch of map ``b`` to map ``a``, one line for each thing to know."""
    std = None if stitch.covariance is None else deviations(stitch.T_a_b, stitch.covariance)
    numbers = zip(("x", "y", "yaw"), stitch.T_a_b, "mm°", [None] * 3 if std is None else std, strict=True)
    lines = [f"{b} in the frame of {a}"]
    for name, value, unit, sigma in numbers:
        factor = 180.0 / np.pi if unit == "°" else 1.0
        spread = "" if sigma is None else f" ± {factor * sigma:.3f}"
        exactly = f"   ({value:.5f} rad)" if unit == "°" else ""
        lines.append(f"  {name:<9} {factor * value:10.3f}{spread} {unit}{exactly}")
    if std is None:
        lines.append("  the method tells nothing of how sure it is")
    lines.append(f"  overlap   {stitch.overlap_area:10.1f} m²")
    lines.append(f"  agreement {stitch.agreement:10.2f} of the walls in the overlap are in both maps")
    if stitch.belief is not None:
        meaning = (
            "that it is right at all" if stitch.bend is None else "as bent: orders answers, not calibrated"
        )
        lines.append(f"  belief    {100.0 * as_probability(stitch.belief):10.1f} % {meaning}")
    if stitch.scale != 1.0:
        lines.append(f"  scale     {stitch.scale:10.3f}")
    if stitch.bend is not None:
        largest = stitch.bend.largest_displacement(stitch.T_a_b)
        lines.append(f"  bent      {largest:10.2f} m at most")
    lead = margin(stitch)
    rival = in_words(stitch.alternatives[0].T_a_b) if stitch.alternatives else "none"
    lines.append(f"  runner-up {rival}" + ("" if lead is None else f", margin {lead:.2f}"))
    return "\n".join(lines)
