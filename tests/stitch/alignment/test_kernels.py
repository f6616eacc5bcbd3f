"""Kernels of stitching against answers by hand and slow twins."""

from __future__ import annotations

import numpy as np
import pytest

from slam import se2
from stitch.alignment.kernels import (
    ascend,
    cells_of,
    look_up,
    middle_of_known,
    straight_runs,
    sum_along,
    thin,
)


def test_thinned_points_have_the_mean_normal_of_their_cell() -> None:
    """In one cell east, north and no normal; one alone without a normal; one was seen through."""
    points = np.array([[0.2, 0.2], [0.4, 0.6], [0.6, 0.4], [2.5, 0.5], [1.5, 1.5]])
    normals = np.array([[1.0, 0.0], [0.0, 1.0], [np.nan, np.nan], [np.nan, np.nan], [1.0, 0.0]])
    occupied = np.array([[True, False, True], [False, False, False]])
    found, facing = thin(points, normals, occupied, np.zeros(2), 1.0, 1.0)
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
    found, facing = thin(points, normals, occupied, origin, 0.2, 0.7)
    rows = [groups[cell] for cell in sorted(groups)]
    np.testing.assert_allclose(found, [points[row].mean(axis=0) for row in rows])
    np.testing.assert_allclose(facing, [np.nan_to_num(normals[row]).mean(axis=0) for row in rows], atol=1e-12)


def test_nothing_left_to_thin() -> None:
    found, facing = thin(np.ones((3, 2)), np.ones((3, 2)), np.zeros((4, 4), bool), np.zeros(2), 1.0, 1.0)
    assert found.shape == facing.shape == (0, 2)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_middle_of_what_is_known(sign: float) -> None:
    """Of four points, moved by a quarter turn, two fall on cells that say something, good or bad."""
    known = np.zeros((4, 5), dtype=np.float32)
    known[1, 2] = known[3, 4] = sign
    first, pose = np.array([-2.0, 3.0]), np.array([1.0, -2.0, np.pi / 2.0])
    # cells start at (-2, 3) of 0.5 m: (1, 2) has its middle at (0.25, 2.25), (3, 4) at (1.25, 3.25)
    there = np.array([[0.25, 2.25], [1.25, 3.25], [-0.75, 1.75], [40.0, 0.0]])
    points = se2.transform(se2.inverse(pose), there)
    found = middle_of_known(points, known, first, 0.5, pose)
    np.testing.assert_allclose(found, points[:2].mean(axis=0))
    assert not np.allclose(found, points.mean(axis=0))


def test_where_nothing_is_known_the_middle_is_that_of_all() -> None:
    points, nothing = np.array([[0.1, 0.2], [3.0, 4.0]]), np.zeros((10, 10), dtype=np.float32)
    found = middle_of_known(points, nothing, np.zeros(2), 0.5, np.zeros(3))
    np.testing.assert_allclose(found, [1.55, 2.1])


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
    found = straight_runs(occupied, reach, 8)
    assert (found[~occupied] == 0).all()
    for i, j in np.argwhere(occupied):
        runs = slow_run(occupied, i, j, reach, 8)
        assert found[i, j] == next((run for run in runs if run > reach), max(runs))
    assert found.max() == (7 if reach == 3 else 20)  # the diagonal, 14√2


def slow_sum(
    field: np.ndarray, first: np.ndarray, points: np.ndarray, weights: np.ndarray, T: np.ndarray
) -> float:
    """Bilinear, cells of 0.5 m, nothing beyond the centres of the outermost."""
    total = 0.0
    for (x, y), weight in zip(se2.transform(T, points) / 0.5 - first - 0.5, weights, strict=True):
        if 0.0 <= x < field.shape[1] - 1 and 0.0 <= y < field.shape[0] - 1:
            i, j = int(y), int(x)
            v, u = y - i, x - j
            total += weight * np.array([1.0 - v, v]) @ field[i : i + 2, j : j + 2] @ np.array([1.0 - u, u])
    return total


def test_sums_are_those_of_the_slow_twin() -> None:
    rng = np.random.default_rng(4)
    field, first = rng.normal(size=(9, 11)).astype(np.float32), np.array([-4.0, -6.0])
    points, weights, poses = rng.uniform(-3, 3, (60, 2)), rng.uniform(size=60), rng.normal(size=(5, 3))
    expected = [slow_sum(field, first, points, weights, T) for T in poses]
    np.testing.assert_allclose(sum_along(field, first, 0.5, points, weights, poses), expected, rtol=1e-12)
    assert sum_along(field[:1], first, 0.5, points, weights, poses).tolist() == [0.0] * 5


def test_a_climb_takes_the_steps_of_the_slow_twin() -> None:
    """The best neighbour as long as it is better, the first one in any case; the twin skips nothing."""
    rng = np.random.default_rng(5)
    field_a, field_b = (
        rng.normal(size=(30, 30)).astype(np.float32),
        -rng.uniform(size=(30, 30)).astype(np.float32),
    )
    a, b = (rng.uniform(-6.0, 6.0, (40, 2)) for _ in range(2))
    weights, first, information = rng.uniform(size=40), np.array([-15.0, -15.0]), np.diag([3.0, 1.0, 20.0])
    expected = np.array([0.2, 0.1, 0.3])

    def score(T: np.ndarray) -> float:
        error = se2.between(expected, T)
        seen = slow_sum(field_a, first, b, weights, T) + slow_sum(field_b, first, a, weights, se2.inverse(T))
        return seen - 0.5 * error @ information @ error

    for seed in range(6):
        start, step = np.random.default_rng(seed).uniform(-1.0, 1.0, 3), np.array([0.3, 0.3, 0.1])
        at, best = start, -np.inf
        for halving in range(2):
            for _ in range(5):
                steps = np.concatenate([np.eye(3), -np.eye(3)]) * step / 2**halving
                scores = [score(at + one) for one in steps]
                if max(scores) <= best:
                    break
                at, best = at + steps[int(np.argmax(scores))], max(scores)
        found, top = ascend(
            field_a, first, a, weights, field_b, first, b, weights, 0.5, expected, information, start,
            np.zeros(2), step, 1, 4,
        )  # fmt: skip
        np.testing.assert_allclose(found, at, atol=1e-9)
        assert top == pytest.approx(best)
