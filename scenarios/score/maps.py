"""A map that was handed in, against the map drawn with true poses."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from scenarios.evaluation.maps import DEFINITIONS, RESOLUTION, compare, occupied_cells, true_map
from scenarios.evaluation.metric import NO_TRUTH, Values, absent
from slam import se2
from slam.cli import InputError
from slam.formats import FormatError
from slam.mapping.occupancy import Grid
from slam.mapping.submap import Submap
from slam.recording import Recording
from slam.se2 import Array
from stitch.align import NoStitch, align
from stitch.alignment.config import AlignConfig
from stitch.alignment.walls import surfaces
from stitch.command.maps import check_size, cropped, read_submap


def map_answer_metrics(path: Path, recording: Recording) -> Values:
    """F1, IoU and chamfer of the walls of the ROS map at ``path``.

    A map has a frame of its own, so it is laid on the true map where the two agree best, rigidly and without
    scale. Raises `InputError` for a map that cannot be read.
    """
    try:
        found, _ = read_submap(path)
        check_size([found], AlignConfig())
    except FormatError as error:
        raise InputError(str(error)) from error
    truth = true_map(recording)
    if truth is None:
        return absent(DEFINITIONS, NO_TRUTH)
    known = cropped(truth)
    target = Submap(0, 1, np.zeros(3), surfaces(known), known)
    result = align(target, found)
    best = result.best if isinstance(result, NoStitch) else result
    if best is None:
        reason = result.reason if isinstance(result, NoStitch) else ""
        return absent(DEFINITIONS, f"the map cannot be laid on the true one: {reason}")
    return compare(_cells(found.grid, best.T_a_b), occupied_cells(truth), RESOLUTION)


def _cells(grid: Grid, T: Array) -> np.ndarray:
    """Lattice indices ``(n, 2)`` of the occupied cells of a grid whose frame is at ``T (3,)``, each sampled
    as finely as the lattice is."""
    parts = int(np.ceil(grid.resolution / RESOLUTION))
    inside = ((np.arange(parts) + 0.5) / parts - 0.5) * grid.resolution
    offsets = np.stack(np.meshgrid(inside, inside), -1).reshape(-1, 2)
    points = (grid.occupied_points()[:, None] + offsets).reshape(-1, 2)
    return np.unique(np.floor(se2.transform(T, points) / RESOLUTION).astype(np.int64), axis=0)
