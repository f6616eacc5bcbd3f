"""Real maps whose pairs somebody annotated: pictures, keypoints, and which of them are the same."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations
from pathlib import Path

import numpy as np

from slam import se2
from slam.cli import InputError
from slam.mapping.occupancy import Grid
from slam.mapping.submap import Submap
from slam.se2 import Array

RESOLUTION = 0.05
"""Metres to a pixel of the maps, which do not tell."""
MOST_SCALE, MOST_RESIDUAL = 0.03, 16.0
"""Pairs are scored whose fitted scale is this near 1 and whose keypoints then miss by less (pixels, rms)."""
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
    names = [name for name, found in keypoints.items() if found is not None and "layout" not in name]
    pairs, annotated = [], 0
    for a, b in combinations(names, 2):
        same = _numbers(folder / f"association_{a}_{b}.npy")
        if same is None or len(same) < 3:
            continue
        annotated += 1
        rows = same.astype(int)
        pair = _fitted(a, b, keypoints[a][rows[:, 0]], keypoints[b][rows[:, 1]])  # type: ignore[index]
        if abs(pair.scale - 1.0) <= MOST_SCALE and pair.residual < MOST_RESIDUAL:
            pairs.append(pair)
    return pairs, annotated


def _numbers(path: Path) -> Array | None:
    """An array of numbers with two columns; None where there is none (a pickled object is never loaded)."""
    if not path.is_file():
        return None
    try:
        found = np.load(path, allow_pickle=False)
    except ValueError:
        return None
    return found if found.ndim == 2 and found.shape[1] == 2 else None


def _fitted(a: str, b: str, pixels_a: Array, pixels_b: Array) -> AnnotatedPair:
    """The similarity that brings b's keypoints to a's (Umeyama 1991); its scale is not part of ``T_a_b``."""
    p, q = pixels_b - pixels_b.mean(axis=0), pixels_a - pixels_a.mean(axis=0)
    cross, dot = np.sum(p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0]), np.sum(p * q)
    yaw, scale = float(np.arctan2(cross, dot)), float(np.hypot(cross, dot) / np.sum(p * p))
    residual = np.sqrt(np.mean(np.sum((q - scale * p @ se2.rotation(yaw).T) ** 2, axis=1)))
    t = pixels_a.mean(axis=0) - se2.rotation(yaw) @ pixels_b.mean(axis=0)
    middle = pixels_b.mean(axis=0) * RESOLUTION
    return AnnotatedPair(a, b, np.array([*(t * RESOLUTION), yaw]), middle, scale, float(residual))


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
    from scipy.spatial import cKDTree

    moved = se2.transform(T_a_b, b.grid.occupied_points())
    distance, _ = cKDTree(a.grid.occupied_points()).query(moved)
    return float(np.mean(distance <= reach))
