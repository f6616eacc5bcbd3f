"""Wall points know which way they face, and from anywhere the nearest of a class is known."""

from __future__ import annotations

import numpy as np

from slam.mapping.occupancy import Grid
from slam.mapping.submap import Submap
from stitch.alignment.facing import CELL, REACH, classes_of, facing_walls
from stitch.alignment.walls import surfaces


def corridor() -> Submap:
    """A corridor 10 m long and 2 m wide along x, free inside."""
    occupied, free = np.zeros((24, 104), dtype=bool), np.zeros((24, 104), dtype=bool)
    occupied[1, 2:102] = occupied[22, 2:102] = True
    free[2:22, 2:102] = True
    grid = Grid(occupied, free, np.zeros(2), 0.1)
    return Submap(0, 1, np.zeros(3), surfaces(grid), grid)


def test_walls_face_into_the_corridor_and_weigh_their_length() -> None:
    walls = facing_walls(corridor(), 0.3)
    low = walls.points[:, 1] < 1.0
    middle = walls.known & (np.abs(walls.points[:, 0] - 5.0) < 4.0)
    np.testing.assert_allclose(walls.angles[low & middle], 0.5 * np.pi, atol=0.05)
    np.testing.assert_allclose(walls.angles[~low & middle], -0.5 * np.pi, atol=0.05)
    assert abs(walls.weights[walls.known].sum() - 20.0) < 2.0
    assert set(np.round(walls.weights, 9)) <= {CELL, round(0.3 * CELL, 9)}


def test_the_nearest_of_every_class_is_that_of_a_search_of_all() -> None:
    walls = facing_walls(corridor(), 0.3)
    classes = classes_of(walls.angles, walls.known, walls.main)
    rng = np.random.default_rng(0)
    height, width = walls.distance.shape
    for i, j in zip(rng.integers(height, size=50), rng.integers(width, size=50), strict=True):
        centre = walls.corner + (np.array([j, i]) + 0.5) * CELL
        away = np.linalg.norm(walls.points - centre, axis=1)
        for k in range(5):
            own = np.where(classes == k, away, np.inf)
            found = walls.nearest[k, i, j]
            if found < 0:
                assert own.min() > REACH - CELL
            else:
                assert away[found] <= own.min() + CELL
        assert abs(walls.distance[i, j] - away.min()) <= CELL


def test_free_space_is_that_of_the_grid() -> None:
    walls = facing_walls(corridor(), 0.3)
    j, i = np.floor((np.array([5.0, 1.2]) - walls.corner) / CELL).astype(int)
    assert walls.free[i, j]
    assert not walls.free[0, 0]
