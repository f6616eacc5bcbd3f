"""Smoke: what is laid out, the light that passes, and the light that comes back."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sim.floorplan import wall
from sim.laser import Scanner
from sim.laser_effects import Effects
from sim.smoke import Haze, Smoke
from sim.terrain import Terrain
from sim.terrain_kernels import heights_at
from sim.world import World

GROUND = Terrain.level([-1.0, -1.0], [1.0, 1.0], 1.0)
CLEAN = Effects(mixed_pixels=False, dropouts=False, noise=False, quantisation=False)
KAPPA = 0.5


def depth(smoke, start, yaw, length, thickness=np.inf):
    """Distance of scattering and optical depth of one level beam."""
    pose = np.array([[*start, yaw, 0.0, 0.0, 0.3]])
    at, total = Haze(smoke.field, pose, np.zeros(1)).scatter(
        np.array([[length]]), np.array([[float(thickness)]])
    )
    return at[0, 0], total[0, 0]


def uniform(extinction, side=40.0):
    return Smoke.clear([-side, -side], [side, side], 1.0).with_disc([0, 0], 3 * side, extinction)


def seen(smoke, effects, beams=2000, range_max=4.0, prisms=(), seed=0):
    """Ranges of one scan from the origin, beams spread over all directions or, with walls, over 1° ahead."""
    width = np.deg2rad(1.0) if prisms else 2.0 * np.pi
    scanner = Scanner(beams, width, range_max=range_max, mount=(0.0, 0.0, 0.0), effects=effects)
    world = World(tuple(prisms), GROUND)
    still = np.zeros((1, 6))
    return scanner.scan(scanner.caster(world), still, np.random.default_rng(seed), smoke=smoke)[0]


def test_depth_of_uniform_smoke_and_where_the_beam_scatters():
    at, total = depth(uniform(KAPPA), (0.3, -0.2), 0.7, 6.0)
    assert at == np.inf
    assert total == pytest.approx(KAPPA * 6.0)
    at, total = depth(uniform(KAPPA), (0.3, -0.2), 0.7, 6.0, thickness=1.2)
    assert at == pytest.approx(1.2 / KAPPA)
    assert total == 1.2


@pytest.mark.parametrize(("edge", "expected"), [(0.0, 2.0 * 3.0), (1.0, 2.0 * 2.5)])
def test_depth_across_a_disc(edge, expected):
    """κ = 1 over the diameter of 6 m; a soft edge of 1 m takes half a metre off either end."""
    smoke = Smoke.clear([0, 0], [10, 10], 0.05).with_disc([5, 5], 3.0, 1.0, edge)
    assert depth(smoke, (0.0, 5.0), 0.0, 20.0)[1] == pytest.approx(expected, abs=0.06)
    assert depth(smoke, (0.0, 1.9), 0.0, 20.0)[1] == 0.0


def test_depth_across_a_polygon_that_is_not_convex():
    """An L of arms 2 m wide: 2 m across each arm, and nothing across the notch."""
    corners = [[0, 0], [6, 0], [6, 2], [2, 2], [2, 6], [0, 6]]
    smoke = Smoke.clear([-1, -1], [7, 7], 0.05).with_polygon(corners, 0.5)
    assert depth(smoke, (-1.0, 4.0), 0.0, 8.0)[1] == pytest.approx(1.0, abs=0.03)
    assert depth(smoke, (-1.0, 1.0), 0.0, 8.0)[1] == pytest.approx(3.0, abs=0.03)
    assert depth(smoke, (2.2, 2.2), np.pi / 4, 8.0)[1] == pytest.approx(0.0, abs=1e-9)
    soft = Smoke.clear([-1, -1], [7, 7], 0.05).with_polygon(corners, 0.5, edge=1.0)
    assert depth(soft, (-1.0, 4.0), 0.0, 8.0)[1] == pytest.approx(0.5, abs=0.03)


def test_depth_across_a_triangle():
    """Corners (0, 0), (4, 0), (0, 4): at height y it is 4 - y wide."""
    smoke = Smoke.clear([-1, -1], [5, 5], 0.05).with_polygon([[0, 0], [4, 0], [0, 4]], 1.0)
    for y in (1.0, 3.0):
        assert depth(smoke, (-1.0, y), 0.0, 8.0)[1] == pytest.approx(4.0 - y, abs=0.06)


def test_regions_add_up():
    one = Smoke.clear([0, 0], [4, 4]).with_disc([2, 2], 1.0, 0.3)
    both = one.with_polygon([[1, 1], [3, 1], [3, 3], [1, 3]], 0.2)
    assert both.extinction.max() == pytest.approx(0.5)


def test_depth_agrees_with_small_steps():
    rng = np.random.default_rng(0)
    smoke = Smoke(rng.uniform(0.0, 1.0, (12, 15)), (1.0, -2.0), 0.5)
    for _ in range(40):
        start, yaw, length = rng.uniform([-1, -4], [9, 5]), rng.uniform(-4, 4), rng.uniform(0.1, 12.0)
        r = (np.arange(20000) + 0.5) * length / 20000
        points = start + r[:, None] * [np.cos(yaw), np.sin(yaw)]
        kappa = heights_at(points, smoke.field)
        expected = np.cumsum(kappa) * length / 20000
        assert depth(smoke, start, yaw, length)[1] == pytest.approx(expected[-1], abs=2e-3)
        wanted = 0.6 * expected[-1]
        if wanted > 0.0:
            at, _ = depth(smoke, start, yaw, length, wanted)
            assert np.interp(at, r, expected) == pytest.approx(wanted, abs=2e-3)


def test_mean_free_path_is_one_over_the_extinction():
    ranges = seen(uniform(KAPPA), replace(CLEAN, smoke_return=1.0), 5000, range_max=30.0)
    assert np.isfinite(ranges).mean() > 0.93  # those within 0.1 m of the laser are below its range
    beyond = ranges[np.isfinite(ranges)] - 0.1  # without memory: the rest of the path is as long
    assert beyond.mean() == pytest.approx(1.0 / KAPPA, rel=0.05)
    assert np.median(beyond) == pytest.approx(np.log(2.0) / KAPPA, rel=0.06)


def test_a_share_of_the_scattered_beams_returns():
    effects = replace(CLEAN, limits=False, smoke_return=0.3)
    assert np.isfinite(seen(uniform(5.0), effects, 5000)).mean() == pytest.approx(0.3, abs=0.02)


def test_a_wall_behind_smoke_is_seen_by_the_beams_that_get_through():
    """exp(-0.5 · 2) = 37 % of the beams report the wall, half of the others a point before it."""
    ranges = seen(uniform(KAPPA), CLEAN, 4000, prisms=wall([2.06, -2], [2.06, 2]))
    through = np.abs(ranges * np.cos(np.linspace(-1, 1, 4000) * np.deg2rad(0.5)) - 2.0) < 1e-9
    assert through.mean() == pytest.approx(np.exp(-1.0), abs=0.02)
    before = np.isfinite(ranges) & ~through
    assert before.mean() == pytest.approx(0.5 * (np.exp(-0.05) - np.exp(-1.0)), abs=0.02)
    assert ranges[before].max() < 2.01


@pytest.mark.parametrize(("threshold", "visible"), [(0.5, True), (0.6, False)])
def test_an_echo_that_is_too_weak_is_lost(threshold, visible):
    """At half the range limit, two-way depth 2: exp(-2) · 2² = 0.54."""
    effects = replace(CLEAN, smoke_return=0.0, smoke_threshold=threshold)
    ranges = seen(uniform(KAPPA), effects, 400, range_max=4.0, prisms=wall([2.06, -2], [2.06, 2]))
    assert np.isfinite(ranges).any() == visible


def test_an_echo_weakens_with_incidence():
    """A wall met at 60°: cos = ½, the echo above halves to 0.27."""
    for threshold, visible in ((0.25, True), (0.3, False)):
        effects = replace(CLEAN, smoke_return=0.0, smoke_threshold=threshold)
        along = np.array([np.sqrt(0.75), 0.5])
        centre = np.array([2.0 + 0.06 / np.cos(np.pi / 3), 0.0])  # its front is met 2 m ahead
        slanted = wall(centre - 2.0 * along, centre + 2.0 * along)
        assert np.isfinite(seen(uniform(KAPPA), effects, 400, prisms=slanted)).any() == visible


@pytest.mark.parametrize("effects", [CLEAN, Effects()])
def test_no_smoke_and_the_switch_change_nothing_else(effects):
    prisms = wall([2.06, -2], [2.06, 2])
    clear = seen(None, effects, prisms=prisms)
    np.testing.assert_array_equal(seen(uniform(0.0), effects, prisms=prisms), clear)
    np.testing.assert_array_equal(seen(uniform(1.0), replace(effects, smoke=False), prisms=prisms), clear)
    assert not np.array_equal(seen(uniform(1.0), effects, prisms=prisms), clear, equal_nan=True)


@pytest.mark.parametrize("extinction", [np.zeros((1, 5)), np.full((3, 3), -0.1), np.full((3, 3), np.inf)])
def test_bad_smoke_is_refused(extinction):
    with pytest.raises(ValueError, match="smoke"):
        Smoke(extinction, (0.0, 0.0), 0.1)
