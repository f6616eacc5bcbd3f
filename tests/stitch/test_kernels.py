"""Kernels of stitching against answers by hand and slow twins."""

from __future__ import annotations

import numpy as np
import pytest

from slam import se2
from stitch.kernels import middle_of_known, thin


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
