"""Real maps as pictures, with annotated keypoints and their associations between maps."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from slam import se2
from slam.cli import InputError
from slam.mapping.occupancy import Grid
from slam.mapping.submap import Submap
from slam.se2 import Array

RESOLUTION = 0.05
"""Assumed metres to a pixel: the maps do not state it."""
MOST_SCALE, MOST_RESIDUAL = 0.03, 16.0
"""A pair is scored whose fitted scale differs from 1 by less and whose residual is less (pixels, rms)."""
WALL, OPEN = 60, 200
"""Grey levels: at most that of a wall, at least that of free space; what lies between is unknown."""


@dataclass(frozen=True)
class AnnotatedPair:
    """Two maps by name, and the rigid transform ``T_a_b (3,)`` m that their annotations fit best.

    ``middle_b (2,)`` m is the middle of b's annotated keypoints, ``residual`` their rms error in pixels.
    """

    a: str
    b: str
    T_a_b: Array
    middle_b: Array
    scale: float
    residual: float


def annotated_pairs(folder: Path) -> tuple[list[AnnotatedPair], int]:
    """Pairs of a folder's maps that can be scored, and how many were annotated.

    ``<name>.png``, ``keypoints_<name>.npy (n, 2)`` in pixels from the lower left corner, and
    ``association_<a>_<b>.npy (m, 2)``, rows of both. Pickled files are left alone.
    """
    keypoints = {
        path.stem: _numbers(folder / f"keypoints_{path.stem}.npy") for path in sorted(folder.glob("*.png"))
    }
    names = [name for name, points in keypoints.items() if points is not None and "layout" not in name]
    pairs, annotated = [], 0
    for a, b in combinations(names, 2):
        same = _numbers(folder / f"association_{a}_{b}.npy")
        if same is None or len(same) < 3:
            continue
        annotated += 1
        rows = same.astype(int)
        pair = _fit(a, b, keypoints[a][rows[:, 0]], keypoints[b][rows[:, 1]])  # type: ignore[index]
        if abs(pair.scale - 1.0) <= MOST_SCALE and pair.residual < MOST_RESIDUAL:
            pairs.append(pair)
    return pairs, annotated


def _numbers(path: Path) -> Array | None:
    """An array of numbers with two columns; None where there is none (a pickled object is never loaded)."""
    if not path.is_file():
        return None
    try:
        array = np.load(path, allow_pickle=False)
    except ValueError:
        return None
    return array if array.ndim == 2 and array.shape[1] == 2 else None


def _fit(a: str, b: str, pixels_a: Array, pixels_b: Array) -> AnnotatedPair:
    """The similarity that moves b's keypoints onto a's; its scale is not part of ``T_a_b``."""
    T_a_b = se2.fit_rigid(pixels_b, pixels_a)
    p = (pixels_b - pixels_b.mean(axis=0)) @ se2.rotation(T_a_b[2]).T
    q = pixels_a - pixels_a.mean(axis=0)
    scale = float(np.sum(p * q) / np.sum(p * p))
    residual = float(np.sqrt(np.mean(np.sum((q - scale * p) ** 2, axis=1))))
    T_a_b[:2] *= RESOLUTION
    return AnnotatedPair(a, b, T_a_b, pixels_b.mean(axis=0) * RESOLUTION, scale, residual)


def read_map(path: Path, resolution: float = RESOLUTION, walls_only: bool = False) -> Submap:
    """A picture as a submap, the origin of its frame in the lower left corner of the picture.

    Where it shows ``walls_only``, white is unknown, not free.
    """
    import cv2

    from stitch.alignment.walls import surfaces
    from stitch.command.maps import cropped

    grey = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
    if grey is None:
        raise InputError(f"{path}: expected a picture")
    grey = np.ascontiguousarray(grey[::-1])
    free = np.zeros(grey.shape, dtype=bool) if walls_only else grey >= OPEN
    grid = cropped(Grid(grey <= WALL, free, np.zeros(2), resolution))
    return Submap(0, 1, np.zeros(3), surfaces(grid), grid)


def shared_walls(a: Submap, b: Submap, T_a_b: Array, reach: float) -> float:
    """Share of b's occupied cells that lie within ``reach`` m of one of a's once moved by ``T_a_b (3,)``."""
    moved = se2.transform(T_a_b, b.grid.occupied_points())
    distance, _ = cKDTree(a.grid.occupied_points()).query(moved)
    return float(np.mean(distance <= reach))
