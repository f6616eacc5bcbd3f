"""Spoilt scans, each kind against what it says."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sim.corruption import CORRUPTIONS
from sim.corruption.surfaces import first_hits
from sim.laser import Raycaster
from slam.recording import Laser, Recording
from slam.se2 import Array

N, B = 60, 181
ANGLES = np.radians(np.linspace(-90.0, 90.0, B))
BOX = np.array([[0, 0, 8, 0], [8, 0, 8, 6], [8, 6, 0, 6], [0, 6, 0, 0]], dtype=float)


@pytest.fixture(scope="module")
def drive() -> Recording:
    """Along a room of 8 × 6 m, without noise; the last ten beams see nothing."""
    poses = np.column_stack([np.linspace(1.0, 6.0, N), np.full(N, 2.0), np.zeros(N)])
    ranges = Raycaster.from_segments(BOX).cast(poses, ANGLES, 20.0)
    ranges[:, -10:] = np.nan
    return Recording("made", 0.2 * np.arange(N), ranges, ANGLES, Laser(range_max=20.0), poses, truth=poses)


def spoil(drive: Recording, name: str, severity: float | None = None, seed: int = 0) -> Array:
    return CORRUPTIONS[name].at(severity).apply(drive, np.random.default_rng(seed)).ranges


def test_dropped_beams_are_a_share(drive: Recording) -> None:
    there = np.isfinite(drive.ranges)
    left = np.isfinite(spoil(drive, "laser.dropped", 0.3))
    assert np.mean(left[there]) == pytest.approx(0.7, abs=0.02)
    assert not np.any(left & ~there)
    np.testing.assert_array_equal(spoil(drive, "laser.dropped", 0.3)[left], drive.ranges[left])


def test_blind_scans_are_in_a_row(drive: Recording) -> None:
    blind = np.flatnonzero(np.all(np.isnan(spoil(drive, "laser.blind", 15)), axis=1))
    np.testing.assert_array_equal(blind, blind[0] + np.arange(15))


def test_noise_and_bias(drive: Recording) -> None:
    off = spoil(drive, "laser.noise", 0.05) - drive.ranges
    assert np.nanstd(off) == pytest.approx(0.05, rel=0.05)
    assert np.nanmean(off) == pytest.approx(0.0, abs=0.005)
    np.testing.assert_allclose(
        np.nanmax(np.abs(spoil(drive, "laser.bias", -0.05) - drive.ranges + 0.05)), 0.0, atol=1e-12
    )


def test_what_leaves_the_limits_did_not_return(drive: Recording) -> None:
    assert np.all(np.isnan(spoil(drive, "laser.bias", -10.0)))
    near = replace(drive, laser=Laser(range_max=4.0))
    noisy = spoil(near, "laser.noise", 1.0)
    assert np.nanmax(noisy) < 4.0
    assert np.nanmin(noisy) >= 0.1


def test_outliers_are_a_share_of_the_returns(drive: Recording) -> None:
    ranges = spoil(drive, "laser.outliers", 0.2)
    there = np.isfinite(drive.ranges)
    assert np.mean(ranges[there] != drive.ranges[there]) == pytest.approx(0.2, abs=0.02)
    assert np.all(np.isnan(ranges[~there]))
    assert np.nanmax(ranges) <= np.nanmax(drive.ranges)


def test_dust_follows_beer_and_lambert(drive: Recording) -> None:
    ranges = spoil(drive, "laser.dust", 0.2)
    there = np.isfinite(drive.ranges)
    assert np.all(~(ranges[there] > drive.ranges[there]))
    passed = np.mean(ranges[there] == drive.ranges[there])
    assert passed == pytest.approx(np.mean(np.exp(-0.2 * drive.ranges[there])), abs=0.02)
    assert np.mean(np.isfinite(ranges[~there])) > 0.9  # nothing behind within 20 m: grains all the same
    np.testing.assert_array_equal(spoil(drive, "laser.dust", 0.0), drive.ranges)


def test_glass_stays_where_it_is(drive: Recording) -> None:
    assert drive.truth is not None
    ahead = drive.truth[:, :1] + drive.ranges * np.cos(ANGLES)
    aside = drive.truth[:, 1:2] + drive.ranges * np.sin(ANGLES)
    wall = np.flatnonzero((np.abs(aside) < 1e-6).ravel())
    along = wall[np.argsort(ahead.ravel()[wall])]
    shares = []
    for seed in range(20):
        behind = (spoil(drive, "laser.glass", 0.3, seed) - drive.ranges).ravel()[along]
        glass = behind > 1e-9
        assert np.all((behind[glass] >= 0.5) & (behind[glass] <= 4.0))
        assert np.all(np.abs(behind[~glass]) < 1e-9)
        assert np.sum(np.abs(np.diff(behind)) > 1e-9) < 25  # of thousands of beams to a wall of 8 m
        shares.append(np.mean(glass))
    assert np.mean(shares) == pytest.approx(0.3, abs=0.1)


def test_a_mirror_shows_what_the_scan_sees() -> None:
    """From (2, 2), a beam at −45° meets the lower wall at (4, 0), and goes on to the right wall at (8, 4)."""
    pose = np.array([[2.0, 2.0, 0.0]])
    ranges = Raycaster.from_segments(BOX).cast(pose, ANGLES, 20.0)
    recording = Recording("made", [0.0], ranges, ANGLES, Laser(range_max=20.0), pose, truth=pose)
    shown = spoil(recording, "laser.mirror", 1.0)
    beam = np.argmin(np.abs(ANGLES + np.pi / 4.0))
    assert shown[0, beam] == pytest.approx(ranges[0, beam] + np.hypot(4.0, 4.0), abs=0.05)
    np.testing.assert_array_equal(spoil(recording, "laser.mirror", 0.0), ranges)


def test_rays_meet_what_the_ray_caster_sees() -> None:
    rng = np.random.default_rng(0)
    start, bearing = rng.uniform([1, 1], [7, 5], (50, 2)), rng.uniform(-np.pi, np.pi, 50)
    walls = np.vstack([BOX, rng.uniform(0.0, 6.0, (6, 4))])
    poses = np.column_stack([start, bearing])
    seen = Raycaster.from_segments(walls).cast(poses, np.zeros(1), 20.0)[:, 0]
    clear = seen > 0.1
    assert clear.sum() > 40
    np.testing.assert_allclose(first_hits(start, bearing, walls)[clear], seen[clear], atol=1e-6)
    assert np.all(first_hits(start, bearing, np.zeros((0, 4))) == np.inf)


def test_a_mirror_that_shows_nothing_returns_nothing() -> None:
    pose = np.zeros((1, 3))
    ranges = Raycaster.from_segments([[3.0, -9.0, 3.0, 9.0]]).cast(pose, ANGLES, 20.0)
    recording = Recording("made", [0.0], ranges, ANGLES, Laser(range_max=20.0), pose)
    assert np.all(np.isnan(spoil(recording, "laser.mirror", 1.0)))


def test_a_person_walks_along(drive: Recording) -> None:
    ranges = spoil(drive, "laser.person", 1.0)
    covered = np.isfinite(ranges) & ~(ranges == drive.ranges)
    assert np.all(covered.any(axis=1))
    width = covered.sum(axis=1)
    assert 15 <= np.median(width) <= 30  # beams of 1°, of a circle of 0.4 m about a metre away
    assert np.nanmin(np.where(covered, ranges, np.nan), axis=1).mean() == pytest.approx(0.8, abs=0.15)
    assert np.abs(np.diff(np.argmax(covered, axis=1))).max() < 15


def test_a_sector_has_no_other_beams(drive: Recording) -> None:
    spoilt = CORRUPTIONS["laser.sector"].at(90).apply(drive, np.random.default_rng(0))
    assert len(spoilt.angles) == 91
    np.testing.assert_allclose(np.degrees(spoilt.angles[[0, -1]]), [-45.0, 45.0])
    np.testing.assert_array_equal(spoilt.ranges, drive.ranges[:, 45:136])
    with pytest.raises(ValueError, match="two beams"):
        CORRUPTIONS["laser.sector"].at(1.5).apply(drive, np.random.default_rng(0))


def test_a_mount_is_off_by_as_much_as_is_said(drive: Recording) -> None:
    spoilt = CORRUPTIONS["laser.mount"].at(2).apply(drive, np.random.default_rng(0))
    x, y, yaw = spoilt.laser.T_robot_laser
    assert np.hypot(x, y) == pytest.approx(0.1)
    assert abs(np.degrees(yaw)) == pytest.approx(6.0)
    assert spoilt.laser.mount_stated  # or it would be looked for
    np.testing.assert_array_equal(spoilt.ranges, drive.ranges)


def test_upside_down_left_is_right(drive: Recording) -> None:
    np.testing.assert_array_equal(spoil(drive, "laser.upside_down"), drive.ranges[:, ::-1])
