"""What each range effect does, alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sim.laser_effects import Effects, corrupt

LIMITS = (0.1, 4.0)
NONE = Effects(mixed_pixels=False, dropouts=False, noise=False, quantisation=False, limits=False)


def reported(effects, ranges, cosine=1.0, seed=0):
    """Corrupt ranges (N, B, J)."""
    return corrupt(ranges, np.full(ranges.shape, cosine), effects, LIMITS, np.random.default_rng(seed))


def test_without_effects_nothing_changes():
    ranges = np.random.default_rng(1).uniform(0.0, 6.0, (5, 7, 1))
    ranges[0, 0, 0] = np.nan
    np.testing.assert_array_equal(reported(NONE, ranges), ranges[..., 0])


@pytest.mark.parametrize("switch", ["mixed_pixels", "dropouts", "noise", "quantisation", "limits"])
def test_every_switch_changes_something_and_leaves_the_other_draws_alone(switch):
    rng = np.random.default_rng(2)
    ranges = np.repeat(rng.uniform(0.05, 5.0, (40, 50, 1)), 3, axis=2)
    ranges[::2, ::2, 2] += 1.0
    everything, without = Effects(), replace(Effects(), **{switch: False})
    on = reported(everything, ranges, cosine=0.2)
    off = reported(without, ranges[..., : without.footprint(np.zeros(1)).shape[1]], cosine=0.2)
    assert not np.array_equal(on, off, equal_nan=True)
    np.testing.assert_array_equal(on, reported(everything, ranges, cosine=0.2))
    if switch in ("mixed_pixels", "noise", "quantisation"):
        assert (np.isnan(on) == np.isnan(off)).mean() > 0.95


def test_noise_grows_with_range():
    effects = replace(NONE, noise=True, noise_constant=0.01, noise_slope=0.005)
    for r in (1.0, 10.0):
        out = reported(effects, np.full((200, 100, 1), r))
        assert out.std() == pytest.approx(0.01 + 0.005 * r, rel=0.02)
        assert out.mean() == pytest.approx(r, abs=0.002)


def test_quantum():
    out = reported(replace(NONE, quantisation=True), np.array([[[1.2345], [0.996]]]))
    np.testing.assert_allclose(out, [[1.23, 1.00]], atol=1e-12)


def test_limits_are_no_return():
    out = reported(replace(NONE, limits=True), np.array([[[0.05], [0.1], [3.99], [4.0], [5.0]]]))
    np.testing.assert_array_equal(np.isnan(out), [[True, False, False, True, True]])


@pytest.mark.parametrize(("degrees", "share"), [(0.0, 0.002), (80.0, 0.501), (89.9, 0.965)])
def test_dropouts_by_incidence(degrees, share):
    """1 - (1 - 0.002) (1 - sigmoid((incidence - 80°) / 3°))."""
    out = reported(replace(NONE, dropouts=True), np.full((400, 500, 1), 2.0), np.cos(np.deg2rad(degrees)))
    assert np.isnan(out).mean() == pytest.approx(share, abs=0.003)


def test_sub_rays_that_agree_are_averaged():
    out = reported(replace(NONE, mixed_pixels=True), np.array([[[2.0, 2.03, 2.06]]]))
    assert out[0, 0] == pytest.approx(2.03)


def test_mixed_pixels_lie_between_the_surfaces_else_on_the_nearest():
    effects = replace(NONE, mixed_pixels=True, mixed_probability=0.3)
    out = reported(effects, np.tile([1.0, 1.0, 3.0], (200, 100, 1)))
    mixed = out > 1.0
    assert mixed.mean() == pytest.approx(0.3, abs=0.01)
    assert out[mixed].max() < 3.0
    assert np.all(out[~mixed] == 1.0)


def test_a_sub_ray_that_meets_nothing_makes_no_number_up():
    """Half of the footprint on an edge, half on nothing: the edge's range."""
    out = reported(replace(NONE, mixed_pixels=True), np.array([[[1.5, np.nan, np.nan], [np.nan] * 3]]))
    np.testing.assert_allclose(out, [[1.5, np.nan]])


def test_stated_sigma_is_the_noise_of_the_numbers():
    flat = np.full((300, 300, 1), 0.5049)
    effects = replace(NONE, noise=True, noise_slope=0.0, quantisation=True)
    assert reported(effects, flat).std() == pytest.approx(effects.sigma, rel=0.02)
