"""Is it the same place? What every wall point of one map meets in the other, weighed by experience."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from slam import se2
from slam.se2 import Array
from stitch.alignment.raster import Walls

DISTANCES = np.array([0.02, 0.04, 0.07, 0.12, 0.2, 0.35])
"""Classes of how far [m] a wall point is from the other map's nearest wall."""

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
"""Of the roots of a `Tally.counts`."""
GAPS = np.array([-0.47, 0.04, -2.21])
"""Of the roots of its `Tally.gaps`."""
BIAS, GUIDED = -9.69, 6.19
"""The log-odds of maps that never meet, and what a prior of 1 m and 10° adds where it expects them.

All are learnt: ``python -m scenarios.ablate likeness`` prints them."""


@dataclass(frozen=True)
class Ground:
    """A map for the walls of another to meet.

    ``kinds (n,)``: 0 for a point of a long straight wall, 1 for what may be furniture; ``nearest (H, W)``:
    row of the wall point nearest to a cell of the map's grid, -1 beyond the last of `DISTANCES`.
    """

    walls: Walls
    kinds: np.ndarray
    nearest: np.ndarray

    @classmethod
    def of(cls, walls: Walls) -> Ground:
        """The ground that walls make."""
        from stitch.alignment.likelihood_kernels import nearest_points

        grid = walls.grid
        shape, reach = grid.free.shape, float(DISTANCES[-1])
        nearest = nearest_points(walls.points, grid.origin, shape, grid.resolution, reach)
        return cls(walls, (walls.weights < 1.0).astype(np.int64), nearest)


@dataclass(frozen=True)
class Tally:
    """How many wall points, of both maps, met what in the other.

    ``counts (2, 3, 7)``: by kind of the point (see `Ground`); by how the surfaces face: the same way,
    opposite ways, unknown; by distance (`DISTANCES`). The last column holds, in place of facing: beside a
    wall in its free space (such a point is counted at its distance as well), in free space far from any wall,
    where nothing is known.

    ``gaps (3,)``: points in free space apart from any wall, by whether the other's walls go on in line with
    their own on neither side, on one, on both. The last have walled up a doorway of the other map: furniture
    is moved, but walls are not.
    """

    counts: np.ndarray
    gaps: np.ndarray


def tally(a: Ground, b: Ground, T_a_b: Array) -> Tally:
    """What the walls of both maps meet when b lies at ``T_a_b (3,)``."""
    from stitch.alignment.likelihood_kernels import meet, stand_in_gaps

    counts, gaps = np.zeros((2, 3, len(DISTANCES) + 1), dtype=np.int64), np.zeros(3, dtype=np.int64)
    met, missed = counts[:, :, :-1], counts[:, :, -1]
    for still, moving, T in ((a, b, np.asarray(T_a_b, dtype=np.float64)), (b, a, se2.inverse(T_a_b))):
        grid, others, facing = still.walls.grid, still.walls.points, still.walls.facing
        moved = moving.walls.points, moving.walls.facing
        ground = still.nearest, grid.free, grid.origin, grid.resolution, others, facing
        meet(*moved, moving.kinds, T, *ground, DISTANCES, met, missed)
        stand_in_gaps(*moved, T, *ground, gaps)
    return Tally(counts, gaps)


def likeness(found: Tally) -> float:
    """Log-odds that maps whose walls meet so show the same place.

    Square roots, as points along one wall are no independent witnesses.
    """
    return float(np.sum(WEIGHTS * np.sqrt(found.counts)) + GAPS @ np.sqrt(found.gaps) + BIAS)
