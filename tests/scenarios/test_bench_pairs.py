"""The pairs that the bench of the matcher is made of, and how well they could be matched at best."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from scenarios.bench.matching import calibration, cost
from scenarios.bench.matching import pairs as making
from scenarios.bench.matching.matchers import OURS
from scenarios.bench.matching.scores import measure
from scenarios.bench.suite import matching as bench
from sim.laser import Raycaster
from slam import se2
from slam.cli import InputError
from slam.formats import recording_npz

# Pairs


def test_simulated_scans_are_what_is_seen_from_their_poses(built):
    caster = Raycaster.from_segments(built.walls)
    noise = np.concatenate([p.ranges - caster.cast(p.poses, making.ANGLES) for p in built.pairs])
    assert np.nanstd(noise) == pytest.approx(0.01, rel=0.05)
    assert abs(np.nanmean(noise)) < 0.001
    assert not any(p.truth_covariance.any() for p in built.pairs)


def test_the_second_simulated_pose_is_near_the_first_and_in_its_sight(built):
    caster = Raycaster.from_segments(built.walls)
    for pair in built.pairs:
        T = pair.T_reference_scan
        assert np.all(np.abs(T) <= making.APART)
        np.testing.assert_allclose(se2.compose(pair.poses[0], T), pair.poses[1], atol=1e-12)
        dx, dy = pair.poses[1, :2] - pair.poses[0, :2]
        sight = caster.cast([[*pair.poses[0, :2], np.arctan2(dy, dx)]], np.zeros(1))[0, 0]
        assert sight > np.hypot(dx, dy) + making.CLEARANCE


def test_pairs_and_guesses_are_drawn_from_their_generator(built):
    again = making.simulated(12, np.random.default_rng(100))
    np.testing.assert_array_equal(again.pairs[5].ranges, built.pairs[5].ranges)
    off = making.guesses(built.pairs * 20, making.HARD, np.random.default_rng(1))
    off = off - np.array([p.T_reference_scan for p in built.pairs * 20])
    assert np.all(np.abs(off) <= [0.5, 0.5, np.radians(25.0)])
    assert np.all(np.abs(off).max(axis=0) > [0.45, 0.45, np.radians(22.0)])


def test_rows_are_spread_evenly_from_first_to_last():
    assert making.spread(np.arange(10, 20), 4).tolist() == [10, 13, 16, 19]
    assert making.spread(np.arange(3), 4).tolist() == [0, 1, 2]


def test_intel_pairs_are_consecutive_scans_against_the_peers_poses(logs):
    found = making.intel(logs, 100)
    assert len(found) == 39
    np.testing.assert_allclose(np.sqrt(np.diag(found.pairs[7].truth_covariance)), making.GMAPPING_SIGMA)
    step = 2.0 * np.pi / cost.LAP
    for pair in found.pairs:
        np.testing.assert_allclose(np.hypot(*pair.T_reference_scan[:2]), 2.0 * np.sin(step / 2), rtol=1e-9)
        assert pair.T_reference_scan[2] == pytest.approx(step)
    assert len(making.intel(logs, 5)) == 5


def test_experiment_1_pairs_are_upright_and_moving(logs):
    assert len(making.experiment_1(logs, 100)) == 29  # steps before the fall
    found = making.experiment_1(logs, 100, moving=True)
    assert len(found) == 26  # 3 of them standing
    for pair in found.pairs:
        assert np.any(np.abs(pair.T_reference_scan) > 0.005)
    deviation = np.sqrt(np.diag(found.pairs[0].truth_covariance))
    np.testing.assert_allclose(deviation, 0.01 / np.sqrt(6.0), rtol=0.02)  # two roundings


def test_rounded_truth_scatters_as_its_covariance_says():
    rng = np.random.default_rng(0)
    T = np.array([0.8, 0.1, 0.3]) + rng.uniform(-0.02, 0.02, (4000, 3))
    first = rng.uniform(-3.0, 3.0, (4000, 3))
    rounded = se2.between(first.round(2), se2.compose(first, T).round(2))
    errors = se2.log(se2.between(rounded, T))
    claimed = making.of_rounding(np.array([0.8, 0.1, 0.3]), 0.01)
    np.testing.assert_allclose(np.cov(errors.T), claimed, atol=2e-6)


def test_real_pairs_are_there(shared_data):
    for found, count in (
        (making.intel(shared_data, 20), 20),
        (making.experiment_1(shared_data, 300, moving=True), 299),
    ):
        assert len(found) == count
        some = found.pairs[:: count // 20]
        score = measure(OURS.matcher, some, np.array([p.T_reference_scan for p in some]))
        assert score.success >= 0.8


def test_absent_logs_are_a_reason(tmp_path):
    for make in (making.intel, making.experiment_1):
        assert "is not there (--data names the folder)" in make(tmp_path, 3)


def test_logs_that_cannot_be_used_are_bad_input(logs, tmp_path, built):
    drive = recording_npz.read(logs / making.INTEL)
    (tmp_path / making.EXPERIMENT_1).parent.mkdir(parents=True)
    recording_npz.write(tmp_path / making.EXPERIMENT_1, drive)
    with pytest.raises(InputError, match=r"Robot1.log.*true poses"):
        bench.pair_sets(bench.BenchmarkOptions(pairs=3, data=tmp_path), np.random.default_rng(0))


# The bound


def test_range_gradients_are_those_of_the_ray_caster(built):
    caster, step = Raycaster.from_segments(built.walls), 1e-6
    for pair in built.pairs[:4]:
        pose = pair.poses[1]
        ahead, behind = (
            np.stack(
                [caster.cast([se2.compose(pose, sign * axis)], making.ANGLES)[0] for axis in step * np.eye(3)]
            )
            for sign in (1.0, -1.0)
        )
        expected = (ahead - behind).T / (2.0 * step)
        np.testing.assert_allclose(
            calibration.range_gradients(built.walls, pose, making.ANGLES), expected, atol=1e-6
        )


def test_rays_meet_the_walls_the_ray_caster_says(built):
    pose = built.pairs[0].poses[0]
    ranges, _ = calibration.hits(built.walls, pose, pose[2] + making.ANGLES)
    expected = Raycaster.from_segments(built.walls).cast([pose], making.ANGLES)[0]
    np.testing.assert_allclose(ranges, expected, atol=1e-9)


def test_only_what_both_scans_see_counts():
    """Facing away from each other, two scans of half a circle share nothing; facing alike, everything."""
    here = np.array([2.0, 2.0, 0.3])
    walls = calibration.ROOM
    alike = making.Pair(np.zeros((2, 181)), making.ANGLES, making.LASER, np.stack([here, here]))
    gradients = calibration.range_gradients(walls, here, making.ANGLES)
    everything = gradients.T @ gradients / (2.0 * 0.01**2)
    np.testing.assert_allclose(calibration.pair_information(alike, walls), everything, rtol=1e-9)
    away = replace(alike, poses=np.stack([se2.compose(here, [0.0, 0.0, np.pi - 0.02]), here]))
    assert np.trace(calibration.pair_information(away, walls)) < 0.05 * np.trace(everything)


def test_errors_as_large_as_the_bound_are_efficient(built):
    rng = np.random.default_rng(2)
    pairs = built.pairs * 200
    least = {id(p): np.linalg.inv(calibration.pair_information(p, built.walls)) for p in built.pairs}
    roots = {key: np.linalg.cholesky(covariance) for key, covariance in least.items()}
    errors = np.array([roots[id(p)] @ rng.normal(size=3) for p in pairs])
    found = calibration.efficiency(pairs[:240], built.walls, errors[:240])
    assert found[0] == pytest.approx(1.0, rel=0.25)
    twice = calibration.efficiency(pairs[:240], built.walls, 2.0 * errors[:240])
    assert twice == pytest.approx((found[0] / 4.0, found[1] / 4.0))
