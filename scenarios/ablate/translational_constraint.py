"""How well the walls that two maps share constrain their translation: along a bare corridor, not at all."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from slam import se2
from slam.mapping.submap import Submap
from slam.se2 import Array
from stitch.alignment.raster import walls_of

CELL = 0.1
"""Side of the cells [m] in which walls are compared, one point in each."""
SAME_WALL_DISTANCE = 0.2
"""Walls within this [m] that face the same way are the same."""
SAME_WAY = 0.3
"""Least cosine between the normals of walls that face the same way."""


def translational_constraint(a: Submap, b: Submap, T_a_b: Array) -> float:
    """Metres of shared wall that constrain the worst constrained direction of b at ``T_a_b (3,)`` in a.

    The smaller eigenvalue of the sum of n nᵀ over the shared wall cells, n their unit normals, times the
    cell: the translation's information of Censi (2007) for points without noise. 0 where nothing is shared.
    """
    walls_a, walls_b = walls_of(a, CELL), walls_of(b, CELL)
    if len(walls_a.points) == 0 or len(walls_b.points) == 0:
        return 0.0
    points, facing = se2.transform(T_a_b, walls_b.points), walls_b.facing @ se2.rotation(T_a_b[2]).T
    distance, nearest = cKDTree(walls_a.points).query(points)
    alike = np.sum(facing * walls_a.facing[nearest], axis=1) > SAME_WAY
    points, facing = (
        points[(distance < SAME_WALL_DISTANCE) & alike],
        facing[(distance < SAME_WALL_DISTANCE) & alike],
    )
    _, first = np.unique(np.floor(points / CELL), axis=0, return_index=True)
    normals = facing[first] / np.linalg.norm(facing[first], axis=1, keepdims=True)
    return float(max(np.linalg.eigvalsh(normals.T @ normals)[0], 0.0)) * CELL
