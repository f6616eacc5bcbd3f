"""Logs that we write: read back they are the same recording, to the printed precision."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from slam import se2
from slam.formats import FormatError, carmen, load, relations, usarsim
from slam.formats.text import printable_ranges
from slam.recording import Laser, Odometry, Recording, Relations
from slam.se2 import Array

SCANS, BEAMS = 7, 12
WRITERS = {"usarsim": usarsim.write, "carmen": carmen.write}
POSE_PRECISION = 1e-6


def recording(seed: int = 0) -> Recording:
    """A drive past ±180° of yaw, with every field of an INS, a mount and beams without return."""
    rng = np.random.default_rng(seed)
    ranges = np.round(rng.uniform(0.1, 3.99, (SCANS, BEAMS)), 2)
    ranges[rng.random(ranges.shape) < 0.2] = np.nan
    ranges[0, :4] = [0.1, 3.99, np.nan, 0.11]
    truth = rng.normal(0.0, 5.0, (SCANS, 3))
    truth[:, 2] = se2.wrap(3.0 + 0.2 * np.arange(SCANS))
    return Recording(
        name="drive",
        time=10.0 + 0.3 * np.arange(SCANS),
        ranges=ranges,
        angles=np.linspace(-2.09445, 2.09445, BEAMS),
        laser=Laser(0.1, 4.0, 0.0104, np.array([-0.08, 0.03, 0.2])),
        dead_reckoning=truth + rng.normal(0.0, 0.1, truth.shape) * [1, 1, 0.01],
        source="ins",
        attitude=rng.normal(0.0, 0.2, (SCANS, 2)),
        truth=truth,
    )


def written(form: str, path: Path, given: Recording) -> Recording:
    WRITERS[form](path / "drive.log", given)
    return load(path / "drive.log")


def assert_poses_equal(found: Array | None, expected: Array | None) -> None:
    assert found is not None
    assert expected is not None
    np.testing.assert_allclose(found[:, :2], expected[:, :2], atol=POSE_PRECISION)
    np.testing.assert_allclose(se2.wrap(found[:, 2] - expected[:, 2]), 0.0, atol=POSE_PRECISION)


@pytest.mark.parametrize("form", WRITERS)
@pytest.mark.parametrize("seed", range(3))
def test_read_back_it_is_the_same_recording(form: str, seed: int, tmp_path: Path) -> None:
    given = recording(seed)
    found = written(form, tmp_path, given)
    assert (found.name, found.source, found.odometry) == ("drive", "ins", None)
    np.testing.assert_allclose(found.time, given.time, atol=1e-6)
    np.testing.assert_allclose(found.ranges, given.ranges, atol=1e-9)  # already of two decimals
    np.testing.assert_allclose(found.angles, given.angles, atol=1e-8)
    assert_poses_equal(found.dead_reckoning, given.dead_reckoning)
    assert_poses_equal(found.truth, given.truth)
    np.testing.assert_allclose(found.attitude, given.attitude, atol=5e-6)
    assert (found.laser.range_min, found.laser.range_max, found.laser.sigma_range) == (0.1, 4.0, 0.0104)
    np.testing.assert_allclose(found.laser.T_robot_laser, [-0.08, 0.03, 0.2], atol=1e-5)


@pytest.mark.parametrize("form", WRITERS)
def test_odometry_without_truth_and_attitude(form: str, tmp_path: Path) -> None:
    given = replace(recording(), source="odometry", attitude=None, truth=None)
    found = written(form, tmp_path, given)
    assert (found.source, found.attitude, found.truth) == ("odometry", None, None)
    assert_poses_equal(found.dead_reckoning, given.dead_reckoning)


@pytest.mark.parametrize("form", WRITERS)
def test_stamps_going_backwards_keep_their_order(form: str, tmp_path: Path) -> None:
    given = replace(recording(), time=np.array([10.0, 9.0, 9.0, 12.0, 11.0, 13.0, 5.0]))
    found = written(form, tmp_path, given)
    np.testing.assert_allclose(found.time, given.time)
    assert_poses_equal(found.dead_reckoning, given.dead_reckoning)
    assert_poses_equal(found.truth, given.truth)


@pytest.mark.parametrize("form", WRITERS)
def test_ranges_are_rounded_within_the_limits(form: str, tmp_path: Path) -> None:
    given = recording()
    ranges = given.ranges.copy()
    ranges[1, :4] = [3.9996, 0.10004, 1.23456, np.nan]
    found = written(form, tmp_path, replace(given, ranges=ranges))
    np.testing.assert_array_equal(np.isnan(found.ranges), np.isnan(ranges))
    assert np.nanmax(np.abs(found.ranges - ranges)) <= 0.001
    assert found.ranges[1, 2] == pytest.approx(1.23456, abs=0.0005)


def test_a_long_range_just_below_the_maximum_is_a_return(tmp_path: Path) -> None:
    """Older scanners print a beam without return as a little less than 20 m; our logs state their maximum."""
    given = recording()
    far = replace(
        given, laser=replace(given.laser, range_max=20.0), ranges=np.full(given.ranges.shape, 19.99)
    )
    np.testing.assert_array_equal(written("usarsim", tmp_path, far).ranges, 19.99)


def test_printed_ranges_of_awkward_limits() -> None:
    laser = Laser(range_min=0.0, range_max=4.004)
    np.testing.assert_allclose(
        printable_ranges(np.array([0.001, 4.003, np.nan, 2.0]), laser, 2), [0.01, 4.0, 4.01, 2.0]
    )


def test_carmen_keeps_odometry_at_its_full_rate(tmp_path: Path) -> None:
    given = recording()
    rng = np.random.default_rng(5)
    rows = 3 * np.arange(SCANS) + 1
    time, poses = 9.95 + 0.1 * np.arange(3 * SCANS + 2), rng.normal(0.0, 1.0, (3 * SCANS + 2, 3))
    time[rows] = given.time
    given = replace(
        given,
        source="odometry",
        attitude=None,
        dead_reckoning=poses[rows],
        odometry=Odometry(time, poses, rows),
    )
    found = written("carmen", tmp_path, given)
    assert found.odometry is not None
    np.testing.assert_array_equal(found.odometry.scan_row, rows)
    np.testing.assert_allclose(found.odometry.time, time, atol=1e-6)
    assert_poses_equal(found.odometry.poses, poses)
    assert_poses_equal(found.dead_reckoning, poses[rows])


def test_real_logs_survive(tmp_path: Path, shared_data: Path) -> None:
    real = load(shared_data / "usarsim/iro2012-pre2/Robot1.log")
    for form in WRITERS:
        found = written(form, tmp_path, real)
        np.testing.assert_allclose(found.ranges, real.ranges, atol=1e-12)
        np.testing.assert_allclose(found.angles, real.angles, atol=1e-6)
        assert_poses_equal(found.truth, real.truth)
        assert_poses_equal(found.dead_reckoning, real.dead_reckoning)


def test_relations_survive(tmp_path: Path) -> None:
    given = Relations(np.array([[1.0, 2.5], [2.5, 976052857.337284]]), np.array([[1, 2, 3], [-0.1, 0.2, -3]]))
    relations.write(tmp_path / "a.relations", given)
    found = relations.read(tmp_path / "a.relations")
    np.testing.assert_allclose(found.stamps, given.stamps, atol=1e-6)
    np.testing.assert_allclose(found.T_12, given.T_12, atol=1e-6)


def spread_unevenly(given: Recording) -> Recording:
    return replace(given, angles=np.sort(np.random.default_rng(0).uniform(-2.0, 2.0, BEAMS)))


def to_the_left_only(given: Recording) -> Recording:
    return replace(given, angles=given.angles + 2.5)


def one_beam(given: Recording) -> Recording:
    return replace(given, angles=np.zeros(1), ranges=given.ranges[:, :1])


@pytest.mark.parametrize(
    ("form", "change", "message"),
    [
        ("usarsim", spread_unevenly, "evenly spaced"),
        ("carmen", spread_unevenly, "evenly spaced"),
        ("usarsim", to_the_left_only, "first beam to the right"),
        ("usarsim", one_beam, "at least two beams"),
    ],
)
def test_what_a_format_cannot_say_is_refused(
    form: str, change: Callable[[Recording], Recording], message: str, tmp_path: Path
) -> None:
    with pytest.raises(ValueError, match=message):
        written(form, tmp_path, change(recording()))
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("form", "old", "new", "message"),
    [
        ("usarsim", "{SigmaRange 0.01040000}", "{SigmaRange 0.0}", "SigmaRange 0, expected metres > 0"),
        ("carmen", "reckoning ins ", "reckoning sonar ", "is 'sonar', expected one of ins, odometry"),
        ("carmen", "range_min 0.1 ", "range_min 90 ", "smallest range 90, largest 80"),
        ("carmen", "range_min 0.1 ", "range_min x ", "is 'x', expected a finite number"),
        ("carmen", "PARAM slamstitch_range_min 0.1 0 slamstitch 0", "PARAM slamstitch_range_min", "1 values"),
        ("carmen", "IMU 0 0 0 ", "IMU 0 0 ", "IMU of 15 values, expected 16"),
        ("carmen", "TRUEPOS ", "TRUEPOS nan ", "TRUEPOS of 10 values, expected 9"),
    ],
)
def test_damaged_logs_of_ours_are_refused(
    form: str, old: str, new: str, message: str, tmp_path: Path
) -> None:
    WRITERS[form](tmp_path / "a.log", recording())
    text = (tmp_path / "a.log").read_text()
    assert old in text
    (tmp_path / "a.log").write_text(text.replace(old, new, 1))
    with pytest.raises(FormatError, match=message):
        load(tmp_path / "a.log")


@pytest.mark.parametrize("form", WRITERS)
def test_without_dead_reckoning(form: str, tmp_path: Path) -> None:
    found = written(form, tmp_path, recording().without_dead_reckoning())
    assert found.source == "none"
    np.testing.assert_array_equal(found.dead_reckoning, np.zeros((SCANS, 3)))
    assert_poses_equal(found.truth, recording().truth)
