"""A submap's walls as points, its free space turned."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from slam import se2
from slam.mapping.occupancy import Grid
from slam.mapping.submap import Submap
from stitch.alignment.raster import (
    cells_of,
    look_up,
    rasterise,
    straight_run_lengths,
    thin_points,
    walls_of,
)


def test_wall_points_are_thinned_and_leave_out_what_was_seen_through(plan: dict[str, Any]) -> None:
    occupied, free = np.zeros((10, 10), bool), np.ones((10, 10), bool)
    occupied[2, 3] = True
    free[2, 3] = False
    points = np.array([[3.2, 2.4], [3.4, 2.6], [7.5, 7.5], [-1.0, 2.0], [30.0, 2.0]])
    submap = Submap(0, 1, np.zeros(3), plan["scan_of"](points), Grid(occupied, free, np.zeros(2), 1.0))
    walls = walls_of(submap, 1.0)
    np.testing.assert_allclose(walls.points, [[3.3, 2.5]])
    np.testing.assert_array_equal(walls.facing, [[0.0, 0.0]])


def test_rotated_free_space_has_no_holes() -> None:
    free = np.ones((60, 80), dtype=bool)
    grid = Grid(~free, free, np.array([-1.0, 2.0]), 0.05)
    turned = rasterise(np.zeros((0, 2)), grid, np.array([0.3, -0.2, 0.6]), 0.1)
    assert turned.free.sum() * 0.01 == pytest.approx(4.0 * 3.0, rel=0.02)
    rows, columns = np.nonzero(turned.free)
    for row in np.unique(rows):
        inside = columns[rows == row]
        assert len(inside) == inside.max() - inside.min() + 1


def test_cells_are_those_of_numpy() -> None:
    """Points beside the lattice go to its border."""
    points, T, first = (
        np.random.default_rng(1).uniform(-3.0, 3.0, (200, 2)),
        np.array([0.3, -0.2, 0.7]),
        [-4, -3],
    )
    column, row = (np.floor(se2.transform(T, points) / 0.5) - first).astype(int).T
    assert column.min() < 0
    assert row.max() >= 6
    expected = np.clip(row, 0, 5) * 7 + np.clip(column, 0, 6)
    np.testing.assert_array_equal(cells_of(points, T, np.array(first, dtype=float), (6, 7), 0.5), expected)


def test_cells_looked_up_are_those_of_numpy() -> None:
    rng = np.random.default_rng(2)
    cells, origin, T, first = (
        rng.uniform(size=(9, 12)) < 0.5,
        np.array([-1.1, 0.4]),
        np.array([0.2, 0.1, 0.5]),
        [-5, -2],
    )
    row, column = np.indices((16, 20))
    centres = (np.stack([column, row], -1).reshape(-1, 2) + first + 0.5) * 0.2
    j, i = np.floor((se2.transform(se2.inverse(T), centres) - origin) / 0.3).astype(int).T
    within = (i >= 0) & (i < 9) & (j >= 0) & (j < 12)
    expected = within & cells[np.clip(i, 0, 8), np.clip(j, 0, 11)]
    found = look_up(cells, origin, 0.3, T, np.array(first, dtype=float), (16, 20), 0.2)
    np.testing.assert_array_equal(found, expected.reshape(16, 20))
    assert expected.any()
    assert not within.all()


def test_thinned_points_have_the_mean_normal_of_their_cell() -> None:
    """In one cell east, north and no normal; one alone without a normal; one was seen through."""
    points = np.array([[0.2, 0.2], [0.4, 0.6], [0.6, 0.4], [2.5, 0.5], [1.5, 1.5]])
    normals = np.array([[1.0, 0.0], [0.0, 1.0], [np.nan, np.nan], [np.nan, np.nan], [1.0, 0.0]])
    occupied = np.array([[True, False, True], [False, False, False]])
    found, facing = thin_points(points, normals, occupied, np.zeros(2), 1.0, 1.0)
    np.testing.assert_allclose(found, [[0.4, 0.4], [2.5, 0.5]])
    np.testing.assert_allclose(facing, [[1.0 / 3.0, 1.0 / 3.0], [0.0, 0.0]])


def test_thinning_agrees_with_the_slow_twin() -> None:
    """Cells of the map and of the thinning differ; groups are made with a dictionary."""
    rng = np.random.default_rng(0)
    points, angle = rng.uniform(-3.0, 4.0, (400, 2)), rng.uniform(-np.pi, np.pi, 400)
    normals = np.stack([np.cos(angle), np.sin(angle)], -1)
    normals[rng.uniform(size=400) < 0.2] = np.nan
    occupied, origin = rng.uniform(size=(30, 25)) < 0.5, np.array([-2.9, -2.7])
    groups: dict[tuple[int, ...], list[int]] = {}
    for n, point in enumerate(points):
        column, row = np.floor((point - origin) / 0.2).astype(int)
        if 0 <= row < 30 and 0 <= column < 25 and occupied[row, column]:
            groups.setdefault(tuple(np.floor(point[::-1] / 0.7).astype(int)), []).append(n)
    found, facing = thin_points(points, normals, occupied, origin, 0.2, 0.7)
    rows = [groups[cell] for cell in sorted(groups)]
    np.testing.assert_allclose(found, [points[row].mean(axis=0) for row in rows])
    np.testing.assert_allclose(facing, [np.nan_to_num(normals[row]).mean(axis=0) for row in rows], atol=1e-12)


def test_nothing_left_to_thin_points() -> None:
    found, facing = thin_points(
        np.ones((3, 2)), np.ones((3, 2)), np.zeros((4, 4), bool), np.zeros(2), 1.0, 1.0
    )
    assert found.shape == facing.shape == (0, 2)


def slow_run(occupied: np.ndarray, i: int, j: int, reach: int, directions: int) -> list[int]:
    """How long the runs through a cell are, by direction; cells off the map belong to none."""
    near = {
        (row + di, column + dj)
        for row, column in np.argwhere(occupied)
        for di, dj in ((0, 0), (0, 1), (0, -1), (1, 0), (-1, 0))
        if 0 <= row + di < occupied.shape[0] and 0 <= column + dj < occupied.shape[1]
    }
    runs = []
    for k in range(directions):
        c, s = np.cos(np.pi * k / directions), np.sin(np.pi * k / directions)
        arms = (
            [(round(i + sign * n * s), round(j + sign * n * c)) in near for n in range(1, reach + 1)]
            for sign in (-1, 1)
        )
        runs.append(1 + sum([*arm, False].index(False) for arm in arms))
    return runs


@pytest.mark.parametrize("reach", [3, 40])
def test_straight_runs_are_those_of_the_slow_twin(reach: int) -> None:
    """The longest, or the first that is longer than the reach; in cells up to the map's border too."""
    rng = np.random.default_rng(3)
    occupied = rng.uniform(size=(14, 17)) < 0.15
    occupied[13], occupied[np.arange(14), np.arange(14)] = True, True
    found = straight_run_lengths(occupied, reach, 8)
    assert (found[~occupied] == 0).all()
    for i, j in np.argwhere(occupied):
        runs = slow_run(occupied, i, j, reach, 8)
        assert found[i, j] == next((run for run in runs if run > reach), max(runs))
    assert found.max() == (7 if reach == 3 else 20)  # the diagonal, 14√2
