"""Overlap likelihood: do two maps show the same place? By what their wall points meet in each other."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from slam import se2
from slam.se2 import Array
from stitch.alignment.raster import Walls

DISTANCES = np.array([0.02, 0.04, 0.07, 0.12, 0.2, 0.35])
"""Limits [m] of the classes of a wall point's distance from the other map's nearest wall."""

WEIGHTS = np.array(
    [
        [
            [0.25, 0.27, 0.07, 0.24, -0.15, 0.03, -0.54],
            [-0.14, -0.09, 0.19, 0.21, 0.06, -0.33, -0.43],
            [0.06, 0.11, -0.06, -0.03, 0.24, 0.22, 0.03],
        ],
        [
            [0.09, 0.14, 0.16, -0.00, -0.12, -0.18, -0.04],
            [0.34, 0.05, -0.12, -0.19, 0.02, 0.72, -0.40],
            [0.23, 0.44, 0.41, 0.36, -0.22, 0.38, -0.07],
        ],
    ]
)
"""Weights of the square roots of `OverlapCounts.counts`."""
GAPS = np.array([-0.47, 0.04, -2.21])
"""Weights of the square roots of `OverlapCounts.gaps`."""
BIAS, PRIOR_BONUS = -9.69, 6.19
"""Log-odds of maps that never meet, and what a prior of 1 m and 10° adds where it expects them.

All are learnt: ``python -m scenarios.ablate likeness`` prints them."""


@dataclass(frozen=True)
class FreeSpaceMap:
    """A map in which the wall points of another are looked up.

    ``kinds (n,)`` of its own wall points: 0 on a long straight wall, 1 for what may be furniture; ``nearest
    (H, W)``: row of the wall point nearest to a cell of the map's grid, -1 beyond the last of `DISTANCES`.
    """

    walls: Walls
    kinds: np.ndarray
    nearest: np.ndarray

    @classmethod
    def of(cls, walls: Walls) -> FreeSpaceMap:
        """That of a submap's walls and free space."""
        from stitch.alignment.likelihood_kernels import nearest_points

        grid = walls.grid
        shape, reach = grid.free.shape, float(DISTANCES[-1])
        nearest = nearest_points(walls.points, grid.origin, shape, grid.resolution, reach)
        return cls(walls, (walls.weights < 1.0).astype(np.int64), nearest)


@dataclass(frozen=True)
class OverlapCounts:
    """How many wall points, of both maps together, meet what in the other map.

    ``counts (2, 3, 7)``: by kind of the point (see `FreeSpaceMap`); by how the surfaces face: the same way,
    opposite ways, unknown; by distance (`DISTANCES`). The last column counts, in place of facing: points
    beside a wall in its free space (counted at their distance as well), in free space far from any wall, and
    where nothing is known.

    ``gaps (3,)``: points in free space apart from any wall, by whether the other's walls go on in line with
    their own on neither side, on one, on both. The last close a doorway of the other map, which moved
    furniture does not.
    """

    counts: np.ndarray
    gaps: np.ndarray


def count_overlap(a: FreeSpaceMap, b: FreeSpaceMap, T_a_b: Array) -> OverlapCounts:
    """What the wall points of both maps meet when b lies at ``T_a_b (3,)``."""
    from stitch.alignment.likelihood_kernels import WallLookup, classify_points, count_gap_points

    counts, gaps = np.zeros((2, 3, len(DISTANCES) + 1), dtype=np.int64), np.zeros(3, dtype=np.int64)
    near, off = counts[:, :, :-1], counts[:, :, -1]
    for still, moving, T in ((a, b, np.asarray(T_a_b, dtype=np.float64)), (b, a, se2.inverse(T_a_b))):
        grid, walls, moved = still.walls.grid, still.walls, moving.walls
        onto = WallLookup(still.nearest, grid.free, grid.origin, grid.resolution, walls.points, walls.facing)
        classify_points(moved.points, moved.facing, moving.kinds, T, onto, DISTANCES, near, off)
        count_gap_points(moved.points, moved.facing, T, onto, gaps)
    return OverlapCounts(counts, gaps)


def overlap_log_odds(overlap: OverlapCounts) -> float:
    """Log-odds that two maps with this overlap show the same place there.

    Square roots, as neighbouring points along one wall are not independent.
    """
    return float(np.sum(WEIGHTS * np.sqrt(overlap.counts)) + GAPS @ np.sqrt(overlap.gaps) + BIAS)
