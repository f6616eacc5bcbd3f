"""The front end: what it makes of drives in a room, and of scans that say nothing."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from slam import se2
from slam.odometry.dead_reckoning import DeadReckoning
from slam.odometry.track import Track, Verdict
from slam.odometry.tracker import MANIFOLD_SLAM, FrontendConfig, track
from slam.recording import Recording
from slam.se2 import Array

Record = Callable[..., Recording]
Drive = Callable[..., Array]
Rms = Callable[[Array, Array], float]
Check = Callable[[Track], None]

CONFIGS = {"default": FrontendConfig(), "manifold": MANIFOLD_SLAM}
SOURCES = ("ins", "odometry")
ANY_STEP = FrontendConfig(max_innovation=np.inf)


def wheels(truth: Array, seed: int = 1, scale: float = 1.05) -> Array:
    """Odometry with a wrong scale and noise."""
    rng = np.random.default_rng(seed)
    steps = se2.between(truth[:-1], truth[1:]) * [scale, 1.0, scale]
    steps = steps + rng.normal(0.0, 1.0, steps.shape) * [0.005, 0.005, 0.005]
    poses = [truth[0]]
    for step in steps:
        poses.append(se2.compose(poses[-1], step))
    return np.array(poses)


def ins(truth: Array) -> Array:
    """An INS whose position is good and whose yaw drifts with turning."""
    return np.column_stack([truth[:, :2], se2.wrap(truth[:, 2] * 1.15)])


# Drives in a room


@pytest.mark.parametrize("name", CONFIGS)
@pytest.mark.parametrize("source", SOURCES)
def test_a_straight_drive_with_perfect_odometry(
    room: Array, record: Record, rms: Rms, straight: Drive, assert_consistent: Check, name: str, source: str
) -> None:
    found = track(record(room, straight(), source=source), CONFIGS[name])
    assert_consistent(found)
    assert np.all(found.verdict[1:] == Verdict.MATCHED)
    assert rms(found.poses, straight()) < (0.005 if name == "default" else 0.02)
    np.testing.assert_array_equal(found.poses[0], straight()[0])


def test_without_noise_it_stays_on_the_millimetre(room: Array, record: Record, straight: Drive) -> None:
    found = track(record(room, straight(), noise=0.0))
    np.testing.assert_allclose(found.poses, straight(), atol=0.002)


@pytest.mark.parametrize("name", CONFIGS)
def test_wheels_that_slip_are_put_right(
    room: Array, record: Record, rms: Rms, curve: Drive, assert_consistent: Check, name: str
) -> None:
    truth = curve()
    recording = record(room, truth, wheels(truth))
    found = track(recording, CONFIGS[name])
    assert_consistent(found)
    assert rms(recording.dead_reckoning, truth) > 0.04
    assert rms(found.poses, truth) < (0.01 if name == "default" else 0.03)
    assert np.max(np.abs(se2.wrap(found.poses[:, 2] - truth[:, 2]))) < np.radians(1.5)


def test_an_ins_whose_yaw_drifts_is_put_right(room: Array, record: Record, rms: Rms, curve: Drive) -> None:
    truth = curve()
    found = track(record(room, truth, ins(truth), source="ins"))
    assert rms(found.poses, truth) < 0.01
    assert np.max(np.abs(se2.wrap(found.poses[:, 2] - truth[:, 2]))) < np.radians(1.5)


def test_the_laser_mount_counts(room: Array, record: Record, rms: Rms, curve: Drive) -> None:
    truth = curve()
    mount = np.array([-0.3, 0.1, 0.4])
    behind = record(room, se2.compose(truth, mount)).with_laser_mount(mount)
    recording = replace(behind, dead_reckoning=wheels(truth), truth=truth)
    assert rms(track(recording).poses, truth) < 0.01
    assert rms(track(recording.with_laser_mount(np.zeros(3))).poses, truth) > 0.05


def test_the_same_twice(room: Array, record: Record, curve: Drive) -> None:
    recording = record(room, curve(), wheels(curve()))
    first, second = track(recording), track(recording)
    np.testing.assert_array_equal(first.poses, second.poses)
    np.testing.assert_array_equal(first.covariance, second.covariance)


def test_the_truth_is_not_read(room: Array, record: Record, curve: Drive) -> None:
    recording = record(room, curve(), wheels(curve()))
    blindfolded = track(replace(recording, truth=None))
    np.testing.assert_array_equal(blindfolded.poses, track(recording).poses)


# ManifoldSLAM's flaw: its seed is the absolute dead-reckoned pose


def test_manifold_slam_snaps_to_the_ins_once_they_differ_by_half_a_metre(
    room: Array, record: Record, straight: Drive
) -> None:
    truth = straight(40, 0.1)
    wander = np.column_stack([np.zeros(40), 0.03 * np.arange(40), np.zeros(40)])
    recording = record(room, truth, truth + wander, source="ins")

    def sideways(found: Track) -> Array:
        return found.poses[:, 1] - truth[:, 1]

    off = sideways(track(recording, MANIFOLD_SLAM))
    apart = wander[:, 1] - np.concatenate([[0.0], off[:-1]])
    snapped = int(np.argmax(np.abs(off) > 0.1))
    # Matching holds out until the INS has wandered beyond the reach of the correspondences, then lets go.
    np.testing.assert_allclose(off[:snapped], 0.0, atol=0.02)
    assert 0.5 < apart[snapped] < 0.6
    assert off[snapped] > 0.4
    # The tear stays in the map, and the next one follows.
    assert np.min(off[snapped:]) > 0.4
    assert off[-1] > 0.8
    # Seeded by increments, the same matcher never notices.
    ours = track(recording, replace(MANIFOLD_SLAM, seed_mode="incremental"))
    np.testing.assert_allclose(sideways(ours), 0.0, atol=0.02)


def test_a_far_seed_falls_back_to_the_ins_itself(
    room: Array, record: Record, straight: Drive, assert_consistent: Check
) -> None:
    truth = straight(20, 0.1)
    jump = np.where(np.arange(20)[:, None] >= 10, [30.0, 0.0, 0.0], [0.0, 0.0, 0.0])
    recording = record(room, truth, truth + jump, source="ins")
    found = track(recording, MANIFOLD_SLAM)
    assert_consistent(found)
    assert found.verdict[10] == Verdict.FELL_BACK
    np.testing.assert_array_equal(found.poses[10], recording.dead_reckoning[10])
    assert found.confidence["trace2"][10] == np.inf
    # The next scan is matched to the patch that was put there.
    assert np.all(found.verdict[11:] == Verdict.MATCHED)
    np.testing.assert_allclose(found.poses[11:], recording.dead_reckoning[11:], atol=0.05)


# Scans that say nothing


@pytest.mark.parametrize("name", CONFIGS)
@pytest.mark.parametrize("source", SOURCES)
def test_blind_scans_fall_back_to_dead_reckoning(
    room: Array, record: Record, straight: Drive, assert_consistent: Check, name: str, source: str
) -> None:
    truth = straight()
    recording = record(room, truth, source=source)
    ranges = recording.ranges.copy()
    ranges[12:15] = np.nan
    recording = replace(recording, ranges=ranges)
    found = track(recording, CONFIGS[name])
    assert_consistent(found)
    assert np.all(found.verdict[12:15] == Verdict.FELL_BACK)
    assert np.all(found.matches[12:15] == 0)
    for k in (12, 13, 14):
        j = int(found.reference[k])
        expected = DeadReckoning(recording).body_covariance(j, k, found.poses[k])
        np.testing.assert_allclose(found.covariance[k], expected)
        predicted = DeadReckoning(recording).predict(11, k, found.poses[11])
        np.testing.assert_allclose(found.poses[k], predicted, atol=0.02)
        for column in found.confidence.values():
            assert column[k] == np.inf
    assert np.all(np.isfinite(found.confidence["trace2"][1:12]))


@pytest.mark.parametrize("name", CONFIGS)
def test_a_wholly_blind_drive_is_its_dead_reckoning(
    room: Array, record: Record, straight: Drive, assert_consistent: Check, name: str
) -> None:
    recording = record(room, straight(), wheels(straight()))
    found = track(replace(recording, ranges=np.full_like(recording.ranges, np.nan)), CONFIGS[name])
    assert_consistent(found)
    assert np.all(found.verdict[1:] == Verdict.FELL_BACK)
    np.testing.assert_allclose(se2.log(se2.between(recording.dead_reckoning, found.poses)), 0.0, atol=1e-9)


@pytest.mark.parametrize("name", CONFIGS)
def test_a_single_scan(
    room: Array, record: Record, straight: Drive, assert_consistent: Check, name: str
) -> None:
    found = track(record(room, straight(1)), CONFIGS[name])
    assert_consistent(found)
    assert len(found) == 1
    np.testing.assert_array_equal(found.poses, straight(1))


def test_at_rest_scans_are_skipped(
    room: Array, record: Record, straight: Drive, assert_consistent: Check
) -> None:
    truth = np.concatenate([straight(4), np.tile(straight(4)[-1], (5, 1)), straight(8)[4:]])
    found = track(record(room, truth), MANIFOLD_SLAM)
    assert_consistent(found)
    np.testing.assert_array_equal(np.flatnonzero(found.verdict == Verdict.SKIPPED), [0, 4, 5, 6, 7, 8])
    np.testing.assert_array_equal(found.poses[4:9], np.tile(found.poses[3], (5, 1)))
    # The step after the rest is one from the last pose that was estimated.
    assert found.verdict[9] == Verdict.MATCHED


def test_creeping_adds_up_until_it_counts(room: Array, record: Record, straight: Drive) -> None:
    creeping = straight(13, 0.008)
    found = track(record(room, creeping), MANIFOLD_SLAM)
    np.testing.assert_array_equal(np.flatnonzero(found.verdict == Verdict.MATCHED), [3, 6, 9, 12])


# Settings


def test_a_match_of_too_much_variance_is_not_believed(room: Array, record: Record, straight: Drive) -> None:
    recording = record(room, straight())
    strict = track(recording, replace(MANIFOLD_SLAM, max_variance=1e-3))
    assert np.all(strict.verdict[1:] == Verdict.FELL_BACK)
    # It was an answer all the same: the confidence columns keep it.
    assert np.all(np.isfinite(strict.confidence["trace2"][1:]))
    assert np.all(strict.matches[1:] > 100)


def test_a_match_that_did_not_settle_is_not_believed(room: Array, record: Record, curve: Drive) -> None:
    truth = curve()
    hasty = replace(MANIFOLD_SLAM, match=replace(MANIFOLD_SLAM.match, most_iterations=1))
    found = track(record(room, truth, wheels(truth, scale=1.3)), hasty)
    assert np.mean(found.verdict[1:] == Verdict.FELL_BACK) > 0.3
    assert np.all(np.isfinite(found.confidence["trace2"][1:]))


def test_dead_reckoning_is_trusted_along_a_corridor(corridor: Array, record: Record) -> None:
    truth = np.column_stack([0.15 * np.arange(10), np.zeros(10), np.zeros(10)])
    recording = record(corridor, truth, wheels(truth))
    with_it, without = (
        np.sqrt(track(recording, replace(ANY_STEP, trust_dead_reckoning=trust)).covariance[1:, 0, 0])
        for trust in (True, False)
    )
    assert np.all(with_it < 0.03)
    assert np.all(without > 0.3)


def test_information_of_a_match_is_in_the_body_of_the_scan(corridor: Array, record: Record) -> None:
    around = np.radians(np.arange(-180.0, 180.0, 3.0))
    sideways = np.column_stack([0.15 * np.arange(8), np.zeros(8), np.full(8, np.pi / 2)])
    found = track(record(corridor, sideways, angles=around))
    assert np.all(found.verdict[1:] == Verdict.MATCHED)
    # Forward is across the corridor: that is what the walls tell.
    assert np.all(found.information[1:, 0, 0] > 1e3 * found.information[1:, 1, 1])


def test_keyframes_are_what_scans_are_matched_to(room: Array, record: Record, straight: Drive) -> None:
    recording = record(room, straight(25, 0.06))
    found = track(recording, MANIFOLD_SLAM)
    # Every 0.2 m: the fourth scan of 6 cm steps becomes the next patch.
    keyframes = np.unique(found.reference[1:])
    np.testing.assert_array_equal(np.diff(keyframes), 4)
    ours = track(recording)
    np.testing.assert_array_equal(ours.reference[1:], np.arange(24))


def test_tilted_scans_are_not_matched(
    room: Array, record: Record, straight: Drive, assert_consistent: Check
) -> None:
    attitude = np.zeros((25, 2))
    attitude[7:9] = 0.2
    recording = record(room, straight(), attitude=attitude)
    found = track(recording)
    assert_consistent(found)
    np.testing.assert_array_equal(np.flatnonzero(found.verdict == Verdict.FELL_BACK), [7, 8])
    assert np.all(track(recording, MANIFOLD_SLAM).verdict[1:] == Verdict.MATCHED)


@pytest.mark.parametrize(
    "change",
    [
        {"seed_mode": "absolute"},
        {"reference": "scan"},
        {"method": "wsm"},
        {"covariance": "joint"},
        {"match": replace(FrontendConfig().match, levels=((0.2, 1),))},
        {"skip_distance": 0.2, "skip_angle": 0.2},
        {"extend_distance": 0.5, "extend_angle": 1.0},
        {"map_scans": 2},
        {"trust_dead_reckoning": False},
        {"tilt_limit": 0.01},
        {"max_variance": 1e-3},
        {"max_innovation": 0.01},
    ],
    ids=lambda change: next(iter(change)),
)
def test_every_setting_changes_something(
    room: Array, record: Record, curve: Drive, change: dict[str, object]
) -> None:
    truth = curve()
    attitude = 0.03 * np.random.default_rng(2).standard_normal((len(truth), 2))
    recording = record(room, truth, wheels(truth), attitude=attitude)
    found, other = track(recording), track(recording, replace(FrontendConfig(), **change))  # type: ignore[arg-type]
    assert not np.array_equal(found.covariance, other.covariance, equal_nan=True)


def test_calibration_changes_what_an_ins_predicts(
    room: Array, record: Record, rms: Rms, curve: Drive
) -> None:
    truth = curve(60)
    turned = se2.between(np.array([0.0, 0.0, 0.15]), truth)  # the sensor counts in a world turned by 8.6°
    recording = record(room, truth, turned, source="ins")
    with_it, without = (track(recording, FrontendConfig(calibrate=on)) for on in (True, False))
    assert not np.array_equal(with_it.poses, without.poses)
    wheeled = record(room, truth, turned, source="odometry")
    same = [track(wheeled, FrontendConfig(calibrate=on)).poses for on in (True, False)]
    np.testing.assert_array_equal(same[0], same[1])


def test_an_answer_ten_deviations_from_the_seed_is_not_believed(corridor: Array, record: Record) -> None:
    # A corridor with one box that moves along with the robot: it says that the robot stands still.
    truth = np.column_stack([0.15 * np.arange(12), np.zeros(12), np.zeros(12)])
    recording = record(corridor, truth, source="ins")
    ranges = recording.ranges.copy()
    ranges[:, 75:106] = 0.8 / np.cos(recording.angles[75:106])
    held = replace(recording, ranges=ranges)
    strict, lenient = (track(held, FrontendConfig(max_innovation=most)) for most in (100.0, np.inf))
    assert np.mean(strict.verdict[1:] == Verdict.FELL_BACK) > 0.3
    assert strict.poses[-1, 0] > 0.8 * truth[-1, 0]
    assert lenient.poses[-1, 0] < 0.7 * truth[-1, 0]
