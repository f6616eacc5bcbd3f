"""Kernels that find walls, against answers by hand and slow twins."""

from __future__ import annotations

import numpy as np
import pytest

from stitch.alignment.wall_kernels import straight_run_lengths, thin_points


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
