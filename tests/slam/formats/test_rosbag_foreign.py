"""ROS bags as people record them: other topics and frames, uneven scans, lasers upside down, ROS 1."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from slam import se2
from slam.formats import FormatError, load
from slam.se2 import Array

pytest.importorskip("rosbags", reason="ROS 2 bags need the package rosbags: pip install 'slamstitch[ros]'")

from slam.formats.rosbag.laser_scans import resampled
from tests.slam.formats.bags import BEAMS, Bag, refused


def test_odometry_of_another_rate_is_interpolated_at_the_scans(tmp_path: Path) -> None:
    with Bag(tmp_path / "bag") as bag:
        bag.odometry(1.0, 10.0)
        bag.scan(1.25)
        bag.odometry(2.0, 20.0)
    found = load(tmp_path / "bag")
    np.testing.assert_allclose(found.dead_reckoning, [[12.5, 0.0, 0.1]], atol=1e-9)
    assert found.source == "odometry"
    assert found.odometry is not None
    assert (found.truth, found.attitude) == (None, None)


def test_topics_are_chosen_by_our_names_then_by_the_alphabet(tmp_path: Path) -> None:
    with Bag(tmp_path / "bag") as bag:
        bag.odometry(1.0, 1.0, "/a/odom")
        bag.odometry(1.0, 7.0, "/ground_truth")
        bag.odometry(1.0, 2.0, "/odom")
        bag.scan(1.0, "/z/scan", ranges=np.full(BEAMS, 1.0, dtype=np.float32))
        bag.scan(1.0, "/back/scan", ranges=np.full(BEAMS, 2.0, dtype=np.float32))
    found = load(tmp_path / "bag")
    assert found.dead_reckoning[0, 0] == 2.0
    assert found.truth is not None
    assert found.truth[0, 0] == 7.0
    np.testing.assert_array_equal(found.ranges, np.full((1, BEAMS), 2.0))


def test_mount_is_a_chain_of_static_transforms(tmp_path: Path) -> None:
    with Bag(tmp_path / "bag") as bag:
        bag.link("base_link", "tower", (1.0, 0.0, np.pi / 2))
        bag.link("tower", "laser", (0.5, 0.0, np.pi / 2))
        bag.odometry(1.0, 0.0)
        bag.scan(1.0)
    mount = load(tmp_path / "bag").laser.T_robot_laser
    np.testing.assert_allclose(mount[:2], [1.0, 0.5], atol=1e-9)
    assert abs(se2.wrap(mount[2] - np.pi)) < 1e-9


def test_without_static_transforms_the_mount_is_zero(tmp_path: Path) -> None:
    with Bag(tmp_path / "bag") as bag:
        bag.link("elsewhere", "laser", (1.0, 0.0, 0.0))
        bag.odometry(1.0, 0.0)
        bag.scan(1.0)
    assert load(tmp_path / "bag").laser.T_robot_laser.tolist() == [0.0, 0.0, 0.0]


def test_beams_sent_clockwise_are_turned_round(tmp_path: Path) -> None:
    ranges = np.arange(1.0, 4.0, 0.5, dtype=np.float32)
    with Bag(tmp_path / "bag") as bag:
        bag.odometry(1.0, 0.0)
        bag.scan(1.0, ranges=ranges, angle_min=1.0, angle_max=-1.5, angle_increment=-0.5)
    found = load(tmp_path / "bag")
    np.testing.assert_allclose(found.angles, np.arange(-1.5, 1.1, 0.5))
    np.testing.assert_allclose(found.ranges[0], ranges[::-1])


def test_no_return_is_anything_outside_of_the_limits(tmp_path: Path) -> None:
    said = np.array([np.inf, -np.inf, np.nan, 0.05, 4.0, 3.99, 0.1, 0.0, 9.0], dtype=np.float32)
    with Bag(tmp_path / "bag") as bag:
        bag.odometry(1.0, 0.0)
        bag.scan(1.0, ranges=said)
    expected = [np.nan] * 5 + [3.99, 0.1, np.nan, np.nan]
    np.testing.assert_array_equal(load(tmp_path / "bag").ranges[0], expected)


def test_bags_that_say_too_little(tmp_path: Path) -> None:
    with Bag(tmp_path / "empty"):
        pass
    refused(tmp_path / "empty", "no sensor_msgs/msg/LaserScan")
    with Bag(tmp_path / "blind") as bag:
        bag.odometry(1.0, 0.0)
    refused(tmp_path / "blind", "no sensor_msgs/msg/LaserScan")


BAD_SCANS = {
    "angle_increment is 0 in message 2 of /robot/scan": {"angle_increment": 0.0},
    "angle_min is nan in message 2 of /robot/scan": {"angle_min": np.nan},
    "9 beams are 1 rad apart in message 2 of /robot/scan, expected a full turn": {"angle_increment": 1.0},
}


@pytest.mark.parametrize("message", BAD_SCANS)
def test_a_scan_that_makes_no_sense_is_named(message: str, tmp_path: Path) -> None:
    with Bag(tmp_path / "bag") as bag:
        bag.odometry(1.0, 0.0)
        bag.scan(1.0)
        bag.scan(2.0, **BAD_SCANS[message])
    refused(tmp_path / "bag", message)


def test_bags_that_make_no_sense(tmp_path: Path) -> None:
    with Bag(tmp_path / "nowhere") as bag:
        bag.odometry(1.0, np.nan)
        bag.scan(1.0)
    refused(tmp_path / "nowhere", "dead_reckoning: expected finite values")
    with Bag(tmp_path / "tilted") as bag:
        bag.link("base_link", "laser", (0.0, 0.0, 0.0), roll=np.pi / 4)
        bag.odometry(1.0, 0.0)
        bag.scan(1.0)
    refused(tmp_path / "tilted", "'laser' is tilted by 45° on 'base_link'")
    with Bag(tmp_path / "limits") as bag:
        bag.scan(1.0, range_min=5.0, range_max=4.0)
    refused(tmp_path / "limits", "range_min is 5 and range_max 4 in message 1 of /robot/scan")
    with Bag(tmp_path / "hollow") as bag:
        bag.scan(1.0, ranges=np.zeros(0, dtype=np.float32))
    refused(tmp_path / "hollow", "no scan on /robot/scan has ranges")


# Lasers that people have


def test_scans_of_uneven_length_are_resampled_by_their_own_angles(tmp_path: Path) -> None:
    """A laser in the middle of a square room of 4 m, seen with a beam more or less and a first angle of its
    own."""

    def wall(angles: Array) -> Array:
        return 2.0 / np.maximum(np.abs(np.cos(angles)), np.abs(np.sin(angles)))

    with Bag(tmp_path / "bag") as bag:
        for k, (beams, first) in enumerate([(361, -np.pi), (361, -np.pi), (360, -np.pi), (362, -3.139)]):
            angles = np.linspace(first, np.pi, beams)
            step, ranges = angles[1] - angles[0], wall(angles).astype(np.float32)
            shape = {"angle_min": first, "angle_max": np.pi, "angle_increment": step}
            bag.scan(0.1 * k, ranges=ranges, **shape)
    found = load(tmp_path / "bag")
    assert found.ranges.shape == (4, 361)
    in_corner = np.abs(np.abs(np.tan(found.angles)) - 1.0) < 0.05
    expected = np.tile(wall(found.angles), (4, 1))
    np.testing.assert_allclose(found.ranges[:, ~in_corner], expected[:, ~in_corner], atol=2e-4)
    np.testing.assert_allclose(found.ranges, expected, atol=0.03)
    assert "2 scans of 360 to 362 resampled" in found.notes[0]


def test_resampling_invents_nothing_between_two_surfaces() -> None:
    angles = np.array([0.0, 0.1, 0.2, 0.3])
    ranges = np.array([1.0, 1.0, 3.0, np.nan])
    grid = np.array([-0.2, -0.04, 0.05, 0.14, 0.16, 0.24, 0.26, 0.4])
    np.testing.assert_allclose(
        resampled(ranges, angles, grid), [np.nan, 1.0, 1.0, 1.0, 3.0, 3.0, np.nan, np.nan], atol=1e-12
    )


def test_scans_without_ranges_are_dropped_and_counted(tmp_path: Path) -> None:
    with Bag(tmp_path / "bag") as bag:
        bag.odometry(1.0, 0.0)
        bag.scan(1.0)
        bag.scan(1.1, ranges=np.zeros(0, dtype=np.float32))
        bag.scan(1.2)
    found = load(tmp_path / "bag")
    np.testing.assert_allclose(found.time, [1.0, 1.2])
    assert found.notes[-1] == "2 scans, 1 without ranges dropped"


def test_the_laser_may_be_named(tmp_path: Path) -> None:
    with Bag(tmp_path / "bag") as bag:
        bag.scan(1.0, "/front", ranges=np.full(BEAMS, 1.0, dtype=np.float32))
        bag.scan(1.0, "/rear", ranges=np.full(BEAMS, 2.0, dtype=np.float32))
    assert load(tmp_path / "bag").ranges[0, 0] == 1.0
    assert "laser /front" in load(tmp_path / "bag").notes[0]
    assert "--topic names another: /rear" in load(tmp_path / "bag").notes[0]
    assert load(tmp_path / "bag", topic="/rear").ranges[0, 0] == 2.0
    with pytest.raises(FormatError, match=r"no laser '/side', expected one of .*: /front, /rear"):
        load(tmp_path / "bag", topic="/side")


def test_a_laser_upside_down_is_mirrored(tmp_path: Path) -> None:
    """It turns clockwise: what it calls +1 rad is to the right of where it looks."""
    ranges = np.arange(1.0, 4.0, 0.5, dtype=np.float32)
    with Bag(tmp_path / "bag") as bag:
        bag.link("base_link", "laser", (0.2, 0.1, 0.5), roll=np.pi)
        bag.odometry(1.0, 0.0)
        bag.scan(1.0, ranges=ranges, angle_min=-1.5, angle_max=1.0, angle_increment=0.5)
    found = load(tmp_path / "bag")
    np.testing.assert_allclose(found.angles, np.arange(-1.0, 1.6, 0.5))
    np.testing.assert_allclose(found.ranges[0], ranges[::-1])
    np.testing.assert_allclose(found.laser.T_robot_laser, [0.2, 0.1, 0.5], atol=1e-9)
    assert "upside down: mirrored" in found.notes[0]


def test_a_mount_on_tf_counts_and_a_stated_zero_is_stated(tmp_path: Path) -> None:
    with Bag(tmp_path / "bag") as bag:
        for k in range(3):
            bag.link("base_link", "laser", (0.0, 0.0, 0.0), topic="/tf")
            bag.moved(1.0 + k, 0.1 * k)
            bag.odometry(1.0 + k, 0.1 * k)
            bag.scan(1.0 + k)
    laser = load(tmp_path / "bag").laser
    assert (laser.mount_stated, laser.mount_source) == (True, "/tf")
    with Bag(tmp_path / "silent") as bag:
        bag.odometry(1.0, 0.0)
        bag.scan(1.0)
    assert not load(tmp_path / "silent").laser.mount_stated


# Dead reckoning


def test_odometry_on_tf_alone_is_found(tmp_path: Path) -> None:
    """Neither a wheel, nor a SLAM's correction of the odometry, nor a frame that stands is taken for it."""
    with Bag(tmp_path / "bag") as bag:
        bag.link("base_link", "laser", (0.2, 0.0, 0.0))
        for k in range(4):
            bag.moved(1.0 + k, 0.3 * k, "map", "odom")
            bag.moved(1.0 + k, 1.0 * k)
            bag.moved(1.0 + k, 9.0 * k, "base_link", "a_wheel")
            bag.scan(1.5 + k)
    found = load(tmp_path / "bag")
    np.testing.assert_allclose(found.dead_reckoning[:, 0], [0.0, 1.0, 2.0, 3.0], atol=0.51)
    np.testing.assert_allclose(found.dead_reckoning[:3, 0], [0.5, 1.5, 2.5], atol=1e-9)
    np.testing.assert_allclose(found.laser.T_robot_laser, [0.2, 0.0, 0.0], atol=1e-9)
    assert found.notes[1].startswith("odometry /tf:base_link, 4 poses")
    np.testing.assert_allclose(load(tmp_path / "bag", odometry="/tf").dead_reckoning, found.dead_reckoning)
    named = load(tmp_path / "bag", odometry="/tf:odom")
    np.testing.assert_allclose(named.dead_reckoning[:3, 0], [0.15, 0.45, 0.75], atol=1e-9)


def test_the_odometry_that_moves_is_taken(tmp_path: Path) -> None:
    with Bag(tmp_path / "bag") as bag:
        for k in range(4):
            bag.odometry(1.0 + k, 5.0 + 0.001 * k, "/a/dead")
            bag.odometry(1.0 + k, 2.0 * k, "/b/alive")
            bag.scan(1.0 + k)
    found = load(tmp_path / "bag")
    np.testing.assert_allclose(found.dead_reckoning[:, 0], [0.0, 2.0, 4.0, 6.0], atol=1e-9)
    assert found.notes[1] == "odometry /b/alive, 4 poses (--odometry names another: /a/dead)"
    assert load(tmp_path / "bag", odometry="/a/dead").dead_reckoning[0, 0] == 5.0
    with pytest.raises(FormatError, match=r"no odometry '/c', expected one of .*: /a/dead, /b/alive"):
        load(tmp_path / "bag", odometry="/c")


def test_a_bag_of_ros_1_is_read_like_one_of_ros_2(tmp_path: Path) -> None:
    for name in ("old.bag", "new"):
        with Bag(tmp_path / name) as bag:
            bag.link("base_link", "laser", (0.2, 0.0, 0.3), topic="/tf")
            for k in range(3):
                bag.odometry(1.0 + k, 1.0 * k)
                bag.scan(1.5 + k)
    old, new = load(tmp_path / "old.bag"), load(tmp_path / "new")
    assert (old.name, old.notes) == ("old", new.notes)
    for name in ("time", "ranges", "angles", "dead_reckoning"):
        np.testing.assert_array_equal(getattr(old, name), getattr(new, name))
    np.testing.assert_array_equal(old.laser.T_robot_laser, new.laser.T_robot_laser)
    (tmp_path / "torn.bag").write_bytes((tmp_path / "old.bag").read_bytes()[:5000])
    refused(tmp_path / "torn.bag", "not a readable ROS 1 bag: .*; try rosbag reindex torn.bag")
