"""Walls and furniture."""

from __future__ import annotations

import numpy as np
import pytest

from sim.floorplan import (
    Door,
    Prism,
    bed,
    box,
    column,
    cupboard,
    desk,
    stone,
    table,
    wall,
)
from sim.terrain import Terrain
from sim.world import World


def outlines(prisms, z):
    return World(tuple(prisms), Terrain.level([0.0, 0.0], [1.0, 1.0])).outlines(z)


def area(prism: Prism) -> float:
    x, y = prism.footprint.T
    return 0.5 * float(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)))


def test_a_wall_with_doors_is_solid_but_for_the_doors():
    pieces = wall([1.0, 1.0], [1.0, 9.0], [Door(6.0, 1.0), Door(2.0, 0.8)], thickness=0.1)
    spans = [(p.footprint[:, 1].min(), p.footprint[:, 1].max()) for p in pieces]
    np.testing.assert_allclose(spans, [(0.95, 2.6), (3.4, 6.5), (7.5, 9.05)])
    assert sum(map(area, pieces)) == pytest.approx(0.1 * (8.1 - 1.8))


@pytest.mark.parametrize("doors", [[Door(0.2, 1.0)], [Door(2.0, 1.0), Door(2.5, 1.0)], [Door(9.0, 1.0)]])
def test_doors_that_do_not_fit_are_refused(doors):
    with pytest.raises(ValueError, match="doors do not fit"):
        wall([0.0, 0.0], [4.0, 0.0], doors)


@pytest.mark.parametrize(
    "footprint", [[[0, 0], [0, 1], [1, 0]], [[0, 0], [1, 0]], [[0, 0], [2, 0], [1, 0.1], [1, 2]]]
)
def test_footprints_must_be_convex_and_counter_clockwise(footprint):
    with pytest.raises(ValueError, match="footprint"):
        Prism(np.array(footprint), 0.0, 1.0)


def test_an_empty_vertical_extent_is_refused():
    with pytest.raises(ValueError, match="z_lo < z_hi"):
        box([0, 0, 0], 1, 1, 0.5, 0.5)


def test_a_level_laser_passes_under_beds_and_desk_tops():
    """At 0.3 m only legs and the drawer unit are cut; at 0.5 m the mattress is."""
    for pieces, solid in ((bed([0, 0, 0.3]), 4), (desk([0, 0, 0.3]), 5)):
        assert len(outlines(pieces, 0.3)) == 4 * solid
    edges = outlines(bed([0, 0, 0]), 0.5)
    assert len(edges) == 4
    assert np.hypot(*(edges[:, 2:] - edges[:, :2]).T).max() == pytest.approx(2.0)
    assert max(p.z_hi for p in bed([0, 0, 0]) + desk([0, 0, 0])) < 1.0
    assert outlines([], 0.3).shape == (0, 4)


def test_one_sees_under_a_table_and_not_through_a_cupboard():
    assert len(outlines(table([0, 0, 0.3]), 0.3)) == 4 * 4
    assert np.abs(outlines(table([0, 0, 0], 1.6, 0.8, 0.7), 0.68)[:, 0]).max() == pytest.approx(0.8)
    assert all(len(outlines(cupboard([0, 0, 0]), z)) == 4 for z in (0.0, 0.3, 1.79))
    assert len(outlines(cupboard([0, 0, 0]), 1.81)) == 0


def test_a_column_is_round():
    footprint = column([2.0, 3.0], 0.3, sides=20).footprint
    np.testing.assert_allclose(np.hypot(*(footprint - [2.0, 3.0]).T), 0.3)
    assert area(column([0.0, 0.0], 0.3, sides=200)) == pytest.approx(np.pi * 0.09, rel=1e-3)


def test_stones_are_irregular_and_within_their_radius():
    rng = np.random.default_rng(0)
    stones = [stone([1.0, -1.0], 0.3, 0.4, rng) for _ in range(200)]
    assert max(np.hypot(*(s.footprint - [1.0, -1.0]).T).max() for s in stones) <= 0.3
    areas = np.array([area(s) for s in stones])
    assert areas.min() > 0.02
    assert areas.std() > 0.02
    assert stones[0].z_hi == 0.4
