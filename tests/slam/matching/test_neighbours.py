"""Nearest neighbours on the repeating lattice against looking at every point."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from slam.matching.neighbours import build, empty, insert, nearest, nearest_all, remove
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


def assert_found(
    points: Array,
    lattice: tuple,
    x: float,
    y: float,
    radius: float,
    hint: int = -1,
    gone: slice = slice(0, 0),
) -> None:
    row = nearest(points, lattice, x, y, radius, hint)
    found = float(np.hypot(*(points[row] - [x, y]))) if row >= 0 else np.inf
    left = np.delete(points, gone, axis=0)
    expected = slowly(left, x, y, radius) if len(left) else np.inf
    if not np.isinf(expected) and abs(expected - radius) < 1e-12:
        return  # rounding decides which side of the circle it is on
    assert found == pytest.approx(expected, abs=1e-12)


@quick
@given(
    cloud,
    coordinate,
    coordinate,
    st.sampled_from([0.05, 0.1, 0.37, 5.0]),
    st.sampled_from([4, 16]),
    st.sampled_from([0.15, 0.5, 4.0]),
    st.integers(-1, 39),
)
def test_twin(points: Array, x: float, y: float, cell: float, side: int, radius: float, hint: int) -> None:
    hint = min(hint, len(points) - 1)
    assert_found(points, build(points, cell, side), x, y, radius, hint)


@quick
@given(cloud, coordinate, coordinate, st.integers(0, 39), st.integers(0, 39))
def test_twin_after_points_have_gone(points: Array, x: float, y: float, a: int, b: int) -> None:
    lattice = build(points, 0.1, 8)
    start, stop = sorted((min(a, len(points)), min(b, len(points))))
    remove(points, lattice, start, stop)
    assert_found(points, lattice, x, y, 0.7, gone=slice(start, stop))
    insert(points, lattice, start, stop)
    assert_found(points, lattice, x, y, 0.7)


def test_twin_on_a_scans_scale() -> None:
    rng = np.random.default_rng(1)
    points = rng.uniform(-5.0, 5.0, (400, 2))
    lattice = build(points, 0.2, 16)
    queries = rng.uniform(-7.0, 7.0, (300, 2))
    for x, y in queries:
        assert_found(points, lattice, x, y, 0.5)
    rows = nearest_all(points, lattice, queries, 0.5)
    np.testing.assert_array_equal(rows, [nearest(points, lattice, x, y, 0.5, -1) for x, y in queries])


@pytest.mark.parametrize(("x", "y"), [(1e4, 0.0), (-1e4, 3.0), (0.0, -1e4)])
def test_far_outside(x: float, y: float) -> None:
    points = np.array([[0.0, 0.0], [1.0, 1.0]])
    lattice = build(points, 0.2, 16)
    assert nearest(points, lattice, x, y, 0.5, -1) == -1
    assert_found(points, lattice, x, y, 2e4)


def test_the_radius_is_exclusive() -> None:
    points = np.array([[0.5, 0.0]])
    lattice = build(points, 0.2, 16)
    assert nearest(points, lattice, 0.0, 0.0, 0.5, -1) == -1
    assert nearest(points, lattice, 0.0, 0.0, 0.5001, -1) == 0


def test_cells_a_lattice_apart_share_a_bucket_and_are_told_apart() -> None:
    points = np.array([[0.05, 0.05], [1.65, 0.05]])  # 16 cells of 0.1 m apart
    lattice = build(points, 0.1, 16)
    assert np.count_nonzero(lattice[1] >= 0) == 1
    assert nearest(points, lattice, 0.05, 0.06, 0.3, -1) == 0
    assert nearest(points, lattice, 1.65, 0.06, 0.3, -1) == 1


def test_an_empty_lattice_finds_nothing() -> None:
    assert nearest(np.zeros((0, 2)), empty(0, 0.1, 8), 0.0, 0.0, 10.0, -1) == -1
