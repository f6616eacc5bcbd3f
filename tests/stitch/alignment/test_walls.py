"""Walls read off cells: where they are, which way they run, and which side is free."""

from __future__ import annotations

import numpy as np
import pytest

from slam import se2
from slam.mapping.occupancy import Grid
from slam.mapping.submap import Submap
from stitch.align import AlignConfig, align
from stitch.alignment.config import RefinementConfig
from stitch.alignment.walls import surfaces

SIDE = 0.1


def grid_of(picture: str) -> Grid:
    """Rows from the top: # occupied, . free, blank unknown."""
    rows = [row for row in picture.split("\n") if row.strip("|")]
    cells = np.array([list(row.strip("|")) for row in rows[::-1]])
    return Grid(cells == "#", cells == ".", np.array([1.0, 2.0]), SIDE)


def test_a_wall_that_is_free_on_one_side_has_a_normal_to_it():
    walls = surfaces(grid_of("|       |\n|#######|\n|.......|\n|.......|"))
    assert len(walls) == 7
    np.testing.assert_allclose(np.sort(walls.points[:, 0]), 1.0 + SIDE * (np.arange(7) + 0.5))
    np.testing.assert_allclose(walls.points[:, 1], 2.0 + 2.5 * SIDE)
    np.testing.assert_allclose(walls.normals, np.tile([0.0, -1.0], (7, 1)), atol=1e-12)
    np.testing.assert_allclose(np.abs(walls.tangents[:, 0]), 1.0)


def test_a_thin_wall_between_rooms_has_both_sides():
    walls = surfaces(grid_of("|.......|\n|#######|\n|.......|"))
    assert sorted(walls.normals[:, 1].round(9)) == [-1.0] * 7 + [1.0] * 7


def test_the_inside_of_a_thick_wall_is_no_surface():
    walls = surfaces(grid_of("|       |\n|#######|\n|#######|\n|#######|\n|.......|"))
    np.testing.assert_allclose(walls.points[:, 1], 2.0 + 1.5 * SIDE)


def test_a_map_of_walls_alone_has_both_sides_of_them():
    walls = surfaces(grid_of("|       |\n|#######|\n|       |"))
    assert sorted(walls.normals[:, 1].round(9)) == [-1.0] * 7 + [1.0] * 7


def test_no_point_leaves_the_wall(plan):
    """A point outside of it would say that the map contradicts itself."""
    rng = np.random.default_rng(100)
    grid = plan["see"](plan["rooms"](rng), plan["walk"](rng, 2.0, 18.0), np.array([9.0, 9.0, 0.5]), rng).grid
    walls = surfaces(grid)
    column, row = np.floor((walls.points - grid.origin) / grid.resolution).astype(int).T
    assert grid.occupied[row, column].all()
    assert np.isnan(walls.normals[:, 0]).mean() < 0.1


def test_a_row_of_unknown_cells_before_a_wall_does_not_hide_it():
    walls = surfaces(grid_of("|       |\n|#######|\n|#######|\n|       |\n|.......|"))
    np.testing.assert_allclose(walls.points[:, 1], 2.0 + 2.5 * SIDE)
    np.testing.assert_allclose(walls.normals[:, 1], -1.0)


def test_a_speck_has_a_place_but_no_direction():
    walls = surfaces(grid_of("|...|\n|.#.|\n|...|"))
    np.testing.assert_allclose(walls.points, [[1.15, 2.15]])
    assert np.isnan(walls.normals).all()
    assert np.isnan(walls.tangent_sigma).all()


@pytest.mark.parametrize("angle", np.radians([10.0, 33.0, 60.0, 105.0, 170.0]))
def test_a_slanted_wall_is_straighter_than_its_cells(angle):
    """Cells that the line passes through are occupied, those below it free, those above it unknown."""
    y, x = (np.indices((120, 120)) + 0.5) * SIDE
    across = np.cos(angle) * (y - 6.0) - np.sin(angle) * (x - 6.0)
    occupied = np.abs(across) <= 0.5 * SIDE * (abs(np.cos(angle)) + abs(np.sin(angle)))
    walls = surfaces(Grid(occupied, (across < 0.0) & ~occupied, np.zeros(2), SIDE))
    inside = np.all((walls.points > 1.0) & (walls.points < 11.0), axis=1)
    found = walls.selected(inside)
    normal = np.array([np.sin(angle), -np.cos(angle)])
    assert np.all(found.normals @ normal > np.cos(np.radians(12.0)))
    off = (found.points - 6.0) @ normal
    centres = (np.argwhere(occupied)[:, ::-1] + 0.5) * SIDE
    centres = centres[np.all((centres > 1.0) & (centres < 11.0), axis=1)]
    assert off.std() < 0.75 * ((centres - 6.0) @ normal).std()


def test_the_scan_matcher_improves_on_what_the_cells_give(plan):
    """Maps without a single scan: normals from their cells make the refinement work."""
    errors = np.zeros((4, 2))
    for k, row in enumerate(errors):
        rng = np.random.default_rng(100 + k)
        building, poses = (
            plan["rooms"](rng),
            np.array([[10.0, 9.0, 0.3], [20.0, 9.0, rng.uniform(-3.0, 3.0)]]),
        )
        a, b = (
            submap_of(plan["see"](building, plan["walk"](rng, *window), pose, rng).grid)
            for window, pose in zip([(2.0, 18.0), (12.0, 28.0)], poses, strict=True)
        )
        centre = b.points.points.mean(axis=0, keepdims=True)
        for refine in (True, False):
            T_a_b = align(a, b, config=AlignConfig(refinement=RefinementConfig(enabled=refine))).T_a_b
            off = se2.transform(T_a_b, centre) - se2.transform(se2.between(*poses), centre)
            row[int(refine)] = np.linalg.norm(off)
    without, refined = np.sqrt(np.mean(errors**2, axis=0))
    assert refined < 0.6 * without
    assert refined < 0.005


def submap_of(grid: Grid) -> Submap:
    return Submap(0, 1, np.zeros(3), surfaces(grid), grid)
