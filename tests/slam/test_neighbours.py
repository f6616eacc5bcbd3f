"""Nearest neighbours on the lattice against looking at every point."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from slam.matching.neighbours import MOST_CELLS, build, nearest
from slam.se2 import Array

quick = settings(deadline=None, max_examples=150, derandomize=True)

# Coordinates on a coarse raster put points and queries on the borders of cells, and points on each other.
raster = st.integers(-12, 12).map(lambda k: 0.1 * k)
coordinate = st.one_of(raster, st.floats(-1.5, 1.5))
cloud = st.lists(st.tuples(coordinate, coordinate), min_size=1, max_size=40).map(np.array)


def slowly(points: Array, x: float, y: float, radius: float) -> float:
    """Distance [m] of the nearest point closer than the radius, inf for none."""
    apart = np.hypot(points[:, 0] - x, points[:, 1] - y)
    return float(apart.min()) if apart.min() < radius else np.inf


def assert_found(points: Array, cell: float, x: float, y: float, radius: float) -> None:
    row = nearest(points, build(points, cell), x, y, radius)
    found = float(np.hypot(*(points[row] - [x, y]))) if row >= 0 else np.inf
    expected = slowly(points, x, y, radius)
    if not np.isinf(expected) and abs(expected - radius) < 1e-12:
        return  # rounding decides which side of the circle it is on
    assert found == pytest.approx(expected, abs=1e-12)


@quick
@given(
    cloud, coordinate, coordinate, st.sampled_from([0.05, 0.1, 0.37, 5.0]), st.sampled_from([0.15, 0.5, 4.0])
)
def test_twin(points: Array, x: float, y: float, cell: float, radius: float) -> None:
    assert_found(points, cell, x, y, radius)


def test_twin_on_a_scans_scale() -> None:
    rng = np.random.default_rng(1)
    points = rng.uniform(-5.0, 5.0, (400, 2))
    for x, y in rng.uniform(-7.0, 7.0, (300, 2)):
        assert_found(points, 0.2, x, y, 0.5)


@pytest.mark.parametrize(("x", "y"), [(1e4, 0.0), (-1e4, 3.0), (0.0, -1e4)])
def test_far_outside_the_lattice(x: float, y: float) -> None:
    points = np.array([[0.0, 0.0], [1.0, 1.0]])
    assert nearest(points, build(points, 0.2), x, y, 0.5) == -1
    assert_found(points, 0.2, x, y, 2e4)


def test_the_radius_is_exclusive() -> None:
    points = np.array([[0.5, 0.0]])
    index = build(points, 0.2)
    assert nearest(points, index, 0.0, 0.0, 0.5) == -1
    assert nearest(points, index, 0.0, 0.0, 0.5001) == 0


def test_every_point_is_in_the_index_once() -> None:
    points = np.random.default_rng(2).uniform(-3.0, 3.0, (200, 2))
    _, _, columns, rows, first, order = build(points, 0.2)
    np.testing.assert_array_equal(np.sort(order), np.arange(200))
    assert first[0] == 0
    assert first[columns * rows] == 200
    for k in range(200):
        assert nearest(points, build(points, 0.2), *points[k], 0.1) == k


def test_a_wide_cloud_does_not_eat_the_memory() -> None:
    points = np.array([[-1e6, 0.0], [0.0, 0.0], [1e6, 2e6], [0.3, 0.0]])
    index = build(points, 0.2)
    assert len(index[4]) <= MOST_CELLS + 1
    assert nearest(points, index, 0.2, 0.0, 0.5) == 3
    assert nearest(points, index, 1e6, 2e6, 0.5) == 2
