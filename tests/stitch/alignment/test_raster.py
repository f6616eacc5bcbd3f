"""A submap's walls as points, its free space turned."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from slam.mapping.occupancy import Grid
from slam.mapping.submap import Submap
from stitch.alignment.raster import rasterise, wall_points


def test_wall_points_are_thinned_and_leave_out_what_was_seen_through(plan: dict[str, Any]) -> None:
    occupied, free = np.zeros((10, 10), bool), np.ones((10, 10), bool)
    occupied[2, 3] = True
    free[2, 3] = False
    points = np.array([[3.2, 2.4], [3.4, 2.6], [7.5, 7.5], [-1.0, 2.0], [30.0, 2.0]])
    submap = Submap(0, 1, np.zeros(3), plan["scan_of"](points), Grid(occupied, free, np.zeros(2), 1.0))
    points, facing = wall_points(submap, 1.0)
    np.testing.assert_allclose(points, [[3.3, 2.5]])
    np.testing.assert_array_equal(facing, [[0.0, 0.0]])


def test_rotated_free_space_has_no_holes() -> None:
    free = np.ones((60, 80), dtype=bool)
    grid = Grid(~free, free, np.array([-1.0, 2.0]), 0.05)
    turned = rasterise(np.zeros((0, 2)), grid, np.array([0.3, -0.2, 0.6]), 0.1)
    assert turned.free.sum() * 0.01 == pytest.approx(4.0 * 3.0, rel=0.02)
    rows, columns = np.nonzero(turned.free)
    for row in np.unique(rows):
        inside = columns[rows == row]
        assert len(inside) == inside.max() - inside.min() + 1
