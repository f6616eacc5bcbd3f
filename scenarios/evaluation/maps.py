"""A method's map against the map drawn with true poses."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from scenarios.evaluation.metric import NO_TRUTH, Definition, Values, absent
from scenarios.evaluation.trajectory import aligned
from slam.mapping.occupancy import Grid, draw
from slam.recording import Recording
from slam.se2 import Array

RESOLUTION = 0.05
"""Side of a cell [m] of the maps compared."""

_BLIND = "Which way the map is bent, what no beam ever hit, and walls drawn twice within a cell."
DEFINITIONS = {
    "map_f1": Definition(
        "", "higher", "occupied cells against the true map's, one cell of tolerance", _BLIND
    ),
    "map_iou": Definition("", "higher", "overlap of the occupied cells, both widened by a cell", _BLIND),
    "map_chamfer": Definition(
        "m", "lower", "mean distance between the walls of both maps, both ways", _BLIND
    ),
}
_NEIGHBOURHOOD = np.stack(np.meshgrid([-1, 0, 1], [-1, 0, 1]), -1).reshape(-1, 2)


def map_at(recording: Recording, poses: Array) -> Grid:
    """The map of a recording's scans seen from robot ``poses (N, 3)``, in 0.05 m cells."""
    return draw(poses, recording.ranges, recording.angles, recording.laser, RESOLUTION)


def true_map(recording: Recording) -> Grid | None:
    """The map drawn with true poses, None without truth."""
    return None if recording.truth is None else map_at(recording, recording.truth)


def map_metrics(poses: Array, recording: Recording, truth_map: Grid | None) -> Values:
    """F1, IoU and chamfer distance of the occupied cells.

    The map is redrawn from ``poses (N, 3)`` after the SE(2) alignment of the trajectory: in the frame of the
    first pose a degree of heading there would outweigh all else. A cell is found when the other map has one
    among its 3 x 3 neighbours. Cells outside what truth has seen count as wrong: both maps are drawn from the
    same beams.
    """
    if truth_map is None or recording.truth is None:
        return absent(DEFINITIONS, NO_TRUTH)
    try:
        grid = map_at(recording, aligned(poses, recording.truth))
    except ValueError as error:
        return absent(DEFINITIONS, f"the map cannot be drawn: {error}")
    estimate, truth = occupied_cells(grid), occupied_cells(truth_map)
    if len(estimate) == 0 or len(truth) == 0:
        return absent(DEFINITIONS, "no occupied cell to compare")
    return compare(estimate, truth, RESOLUTION)


def occupied_cells(grid: Grid) -> np.ndarray:
    """Lattice indices ``(n, 2)``, x and y, of the occupied cells: the same for grids of any origin."""
    rows, columns = np.nonzero(grid.occupied)
    return np.stack([columns, rows], -1) + np.rint(grid.origin / grid.resolution).astype(np.int64)


def compare(estimate: np.ndarray, truth: np.ndarray, resolution: float) -> Values:
    """``map_f1``, ``map_iou`` and ``map_chamfer`` [m] of two non-empty sets of cells ``(n, 2)``. F1 is of
    precision and recall with a tolerance of one cell, IoU of both sets widened by one cell, chamfer the mean
    of the mean distances to the nearest cell of the other set, both ways."""
    a, b = _widened(estimate), _widened(truth)
    both = len(np.intersect1d(a, b, assume_unique=True))
    distance = (cKDTree(truth).query(estimate)[0].mean() + cKDTree(estimate).query(truth)[0].mean()) / 2.0
    return {
        "map_f1": f1(estimate, truth),
        "map_iou": both / (len(a) + len(b) - both),
        "map_chamfer": float(distance) * resolution,
    }


def f1(estimate: np.ndarray, truth: np.ndarray) -> float:
    """Harmonic mean of the shares of two non-empty sets of cells ``(n, 2)`` that the other has, within one
    cell."""
    precision = float(cells_found(estimate, truth).mean())
    recall = float(cells_found(truth, estimate).mean())
    return 0.0 if precision + recall == 0.0 else 2.0 * precision * recall / (precision + recall)


def cells_found(cells: np.ndarray, among: np.ndarray) -> np.ndarray:
    """Which of ``cells (n, 2)`` have one of ``among (m, 2)`` in their 3 x 3 neighbourhood, ``(n,)`` bool."""
    return np.isin(_keys(cells), _widened(among))


def _widened(cells: np.ndarray) -> np.ndarray:
    return np.unique(_keys(cells[:, None] + _NEIGHBOURHOOD))


def _keys(cells: np.ndarray) -> np.ndarray:
    """One integer per cell: sets of these are quicker than a canvas that holds both maps."""
    return (cells[..., 0].astype(np.int64) << 32) + cells[..., 1]
