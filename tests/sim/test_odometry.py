"""Wheel odometry: what the encoders count, against answers worked out by hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sim.dead_reckoning import OdometryConfig, slips, wheel_odometry

GAUGE = 0.22
FIRM = OdometryConfig(slip=0.0, slip_per_tilt=0.0, burst_rate=0.0, skid_ratio=1.5)


def reckoned(left, right, config=FIRM, tilt=(0.0, 0.0), readings=11, start=(0.0, 0.0, 0.0), seed=0):
    """Poses while the tracks turn evenly by ``left`` and ``right`` m in all."""
    tracks = np.linspace(0.0, 1.0, readings)[:, None] * [left, right]
    time = 0.1 * np.arange(readings)
    tilts = np.tile(np.asarray(tilt, dtype=float), (readings, 1))
    return wheel_odometry(start, tracks, tilts, time, GAUGE, config, np.random.default_rng(seed))


def test_straight_on():
    poses = reckoned(2.0, 2.0, start=(1.0, 2.0, np.pi / 2))
    np.testing.assert_allclose(poses[-1], [1.0, 4.0, np.pi / 2], atol=1e-12)
    np.testing.assert_allclose(poses[0], [1.0, 2.0, np.pi / 2])


def test_turning_needs_the_skid_ratio():
    """Tracks ∓ 0.165 m apart by 0.22 m: 1.5 rad for plain differential drive, 1 rad with a ratio of 1.5."""
    assert reckoned(-0.165, 0.165)[-1] == pytest.approx([0.0, 0.0, 1.0])
    assert reckoned(-0.165, 0.165, replace(FIRM, skid_ratio=1.0))[-1, 2] == pytest.approx(1.5)


def test_an_arc_closes_into_a_circle():
    turn = 2.0 * np.pi * GAUGE * 1.5
    poses = reckoned(6.0 - 0.5 * turn, 6.0 + 0.5 * turn, readings=721)
    assert np.hypot(*poses[-1, :2]) < 1e-9
    assert np.ptp(poses[:, 1]) == pytest.approx(6.0 / np.pi, rel=1e-3)


def test_slipping_tracks_count_more_than_the_robot_moves():
    assert reckoned(1.8, 1.8, replace(FIRM, slip=0.1))[-1, 0] == pytest.approx(2.0)
    tilted = replace(FIRM, slip_per_tilt=0.5)
    assert reckoned(1.0, 1.0, tilted, (0.0, -0.3))[-1, 0] == pytest.approx(1.0 / (1.0 - 0.5 * np.sin(0.3)))


def test_slip_never_reaches_one():
    assert slips(np.ones((3, 2)), np.arange(3.0), OdometryConfig(slip=3.0), np.random.default_rng(0)) == (
        pytest.approx(0.95)
    )


def test_bursts_come_and_go_at_their_rates():
    """In the mean on for 1/0.5 s, off for 1/0.25 s: a third of the time; the tracks by themselves."""
    config = replace(FIRM, burst=0.4, burst_rate=0.25, burst_end_rate=0.5)
    time = 0.1 * np.arange(100_000)
    on = slips(np.zeros((len(time), 2)), time, config, np.random.default_rng(1)) == 0.4
    assert on.mean(axis=0) == pytest.approx([1 / 3, 1 / 3], abs=0.03)
    starts = np.sum(on[1:] & ~on[:-1], axis=0)
    assert 0.1 * on.sum(axis=0) / starts == pytest.approx([2.0, 2.0], rel=0.1)
    assert np.mean(on[:, 0] & on[:, 1]) == pytest.approx(1 / 9, abs=0.03)


def test_bursts_bend_the_path():
    config = replace(FIRM, burst=0.5, burst_rate=1.0, burst_end_rate=1.0)
    yaws = [reckoned(10.0, 10.0, config, readings=101, seed=k)[-1, 2] for k in range(10)]
    assert np.std(yaws) > 0.5
    assert np.all(reckoned(0.0, 0.0, config, readings=101) == 0.0)


@pytest.mark.parametrize("bad", [{"slip": -0.1}, {"burst_rate": float("nan")}, {"skid_ratio": 0.0}])
def test_bad_settings_are_refused(bad):
    with pytest.raises(ValueError, match="odometry"):
        OdometryConfig(**bad)
