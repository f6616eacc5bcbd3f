"""The ground: what is built is what is there."""

from __future__ import annotations

import numpy as np
import pytest

from sim.terrain import Terrain
from sim.terrain_kernels import footprint_plane, ground_normal, height_at

LEVEL = Terrain.level([0.0, 0.0], [6.0, 4.0], 0.05)


def test_bilinear_between_nodes_and_level_outside():
    heights = np.array([[0.0, 1.0], [2.0, 5.0]])
    field = Terrain(heights, np.zeros((2, 2)), (10.0, 20.0), 2.0).field
    assert height_at(10.0, 20.0, field) == 0.0
    assert height_at(12.0, 22.0, field) == 5.0
    assert height_at(11.0, 21.0, field) == pytest.approx(2.0)
    assert height_at(10.5, 20.0, field) == pytest.approx(0.25)
    assert height_at(9.99, 20.0, field) == 0.0


def test_a_ramp_rises_evenly_and_ends_in_a_ledge():
    field = LEVEL.with_ramp([1.0, 2.0], [3.0, 2.0], 1.0, 0.4).field
    for x, expected in ((0.5, 0.0), (1.5, 0.1), (2.5, 0.3), (3.0, 0.4), (3.1, 0.0)):
        assert height_at(x, 2.0, field) == pytest.approx(expected, abs=1e-9)
    assert height_at(2.0, 3.0, field) == 0.0
    _, forward, left = footprint_plane(2.0, 2.0, np.pi, 0.4, 0.2, field)
    assert forward == pytest.approx(-0.2)
    assert left == pytest.approx(0.0, abs=1e-12)


def test_slopes_are_those_of_the_footprint():
    x, y = LEVEL.nodes()
    field = Terrain(0.1 * x - 0.2 * y, np.zeros_like(x), (0.0, 0.0), 0.05).field
    height, forward, left = footprint_plane(3.0, 2.0, np.pi / 2, 0.4, 0.2, field)
    assert (height, forward, left) == pytest.approx((-0.1, -0.2, -0.1))
    normal = np.array(ground_normal(3.0, 2.0, field))
    np.testing.assert_allclose(normal, np.array([-0.1, 0.2, 1.0]) / np.sqrt(1.05), atol=1e-9)


def test_a_sill_is_as_high_as_asked_and_where_asked():
    terrain = LEVEL.with_sill([3.0, 1.5], [3.0, 2.5], 0.06, 0.25)
    assert terrain.heights.max() == pytest.approx(0.06)
    x, y = terrain.nodes()
    raised = terrain.heights > 1e-9
    assert np.all(np.abs(x[raised] - 3.0) < 0.125)
    assert np.all(np.abs(y[raised] - 2.0) <= 0.5 + 1e-9)


def test_rubble_stays_in_its_circle_and_is_as_rough_as_asked():
    terrain = LEVEL.with_rubble([2.0, 2.0], 1.0, 0.05, 0.03, np.random.default_rng(0))
    x, y = terrain.nodes()
    outside = np.hypot(x - 2.0, y - 2.0) > 1.0
    assert np.all(terrain.heights[outside] == 0.0)
    assert np.all(terrain.roughness[outside] == 0.0)
    middle = np.hypot(x - 2.0, y - 2.0) < 0.3
    np.testing.assert_allclose(terrain.roughness[middle], 0.03)
    assert 0.005 < terrain.heights[middle].mean() < 0.15


@pytest.mark.parametrize("heights", [np.zeros((1, 5)), np.full((3, 3), np.nan)])
def test_bad_grids_are_refused(heights):
    with pytest.raises(ValueError, match="terrain"):
        Terrain(heights, np.zeros(heights.shape), (0.0, 0.0), 0.1)


def test_a_flight_of_steps_rises_by_equal_risers():
    field = LEVEL.with_steps([1.0, 2.0], [3.0, 2.0], 1.0, 0.4, 4).field
    for x, expected in ((0.9, 0.0), (1.25, 0.1), (1.75, 0.2), (2.25, 0.3), (2.75, 0.4), (3.1, 0.0)):
        assert height_at(x, 2.0, field) == pytest.approx(expected, abs=1e-9)
    assert height_at(2.0, 2.6, field) == 0.0


def test_a_platform_is_level_and_ends_where_asked():
    terrain = LEVEL.with_platform([1.0, 1.0], [3.0, 2.0], 0.3)
    x, y = terrain.nodes()
    e = 1e-6
    inside = (x > 1.0 - e) & (x < 3.0 + e) & (y > 1.0 - e) & (y < 2.0 + e)
    np.testing.assert_array_equal(terrain.heights, np.where(inside, 0.3, 0.0))
    higher = terrain.with_platform([2.0, 1.0], [3.0, 2.0], 0.2)  # what is already there stays
    np.testing.assert_array_equal(higher.heights, terrain.heights)


def test_a_field_of_rubble_covers_its_rectangle_and_fades_at_the_edge():
    terrain = LEVEL.with_rubble_field([1, 1], [5, 3], 0.05, 0.03, np.random.default_rng(0))
    x, y = terrain.nodes()
    depth = np.minimum(np.minimum(x - 1, 5 - x), np.minimum(y - 1, 3 - y))
    assert np.all(terrain.heights[depth < -1e-6] == 0.0)
    np.testing.assert_allclose(terrain.roughness, 0.03 * np.clip(depth / 0.3, 0.0, 1.0), atol=1e-9)
    assert terrain.heights[depth > 0.3].mean() == pytest.approx(0.05, rel=0.25)


def test_hills_are_smooth_at_the_scale_of_a_robot():
    rng = np.random.default_rng(1)
    hills = LEVEL.with_rubble_field([0, 0], [6, 4], 0.15, 0.0, rng, grain=1.5)
    slope = np.hypot(*np.gradient(hills.heights, hills.resolution))[8:-8, 8:-8]
    rubble = LEVEL.with_rubble_field([0, 0], [6, 4], 0.15, 0.0, rng)
    steeper = np.hypot(*np.gradient(rubble.heights, rubble.resolution))[8:-8, 8:-8]
    assert np.median(slope) < 0.4 * np.median(steeper)
    assert np.all(hills.roughness == 0.0)
