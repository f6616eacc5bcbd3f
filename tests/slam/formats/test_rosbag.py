"""ROS 2 bags: ours read back, foreign ones, damaged ones, and what happens without the package rosbags."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from slam import se2
from slam.formats import FormatError, load
from slam.recording import Laser, Odometry, Recording

pytest.importorskip("rosbags", reason="ROS 2 bags need the package rosbags: pip install 'slamstitch[ros]'")

from slam.formats import quaternion, rosbag

SCANS, BEAMS = 6, 9


def recording() -> Recording:
    rng = np.random.default_rng(1)
    ranges = np.round(rng.uniform(0.1, 3.99, (SCANS, BEAMS)), 2)
    ranges[:, 3] = np.nan
    ranges[0, :2] = [0.1, 3.99]
    truth = rng.normal(0.0, 5.0, (SCANS, 3))
    truth[:, 2] = se2.wrap(3.0 + 0.2 * np.arange(SCANS))
    return Recording(
        name="bag",
        time=0.3 * np.arange(SCANS),
        ranges=ranges,
        angles=np.linspace(-2.09445, 2.09445, BEAMS),
        laser=Laser(0.1, 4.0, 0.01, np.array([-0.08, 0.03, 0.2])),
        dead_reckoning=truth + rng.normal(0.0, 0.1, truth.shape) * [1, 1, 0.01],
        source="ins",
        attitude=rng.normal(0.0, 0.2, (SCANS, 2)),
        truth=truth,
    )


def assert_same(found: Recording, given: Recording) -> None:
    assert (found.name, found.source) == (given.name, given.source)
    np.testing.assert_allclose(found.time, given.time, atol=1e-6)
    np.testing.assert_allclose(found.ranges, given.ranges, atol=1e-9)
    np.testing.assert_allclose(found.angles, given.angles, atol=1e-6)
    for name in ("dead_reckoning", "truth", "attitude"):
        difference = se2.wrap(getattr(found, name) - getattr(given, name))
        np.testing.assert_allclose(difference, 0.0, atol=1e-9, err_msg=name)
    assert (found.laser.range_min, found.laser.range_max) == (given.laser.range_min, given.laser.range_max)
    np.testing.assert_allclose(found.laser.T_robot_laser, given.laser.T_robot_laser, atol=1e-9)


@pytest.mark.parametrize(("storage", "suffix"), [("sqlite3", ".db3"), ("mcap", ".mcap")])
def test_read_back_it_is_the_same_recording(storage: str, suffix: str, tmp_path: Path) -> None:
    rosbag.write(tmp_path / "bag", recording(), storage)
    assert_same(load(tmp_path / "bag"), recording())
    assert_same(load(tmp_path / "bag" / f"bag{suffix}"), recording())


def test_odometry_is_kept_at_its_full_rate(tmp_path: Path) -> None:
    given = recording()
    rows = 2 * np.arange(SCANS) + 1
    time, poses = 0.15 * np.arange(2 * SCANS + 1), np.random.default_rng(5).normal(0, 1, (2 * SCANS + 1, 3))
    given = replace(
        given,
        source="odometry",
        attitude=None,
        time=time[rows],
        dead_reckoning=poses[rows],
        odometry=Odometry(time, poses, rows),
    )
    rosbag.write(tmp_path / "bag", given)
    found = load(tmp_path / "bag")
    assert found.source == "odometry"
    assert found.odometry is not None
    np.testing.assert_array_equal(found.odometry.scan_row, rows)
    np.testing.assert_allclose(found.odometry.time, time)
    np.testing.assert_allclose(found.odometry.poses, poses, atol=1e-9)
    np.testing.assert_allclose(found.dead_reckoning, poses[rows], atol=1e-9)


def test_a_replayed_bag_has_what_slam_systems_listen_to(tmp_path: Path) -> None:
    from rosbags.interfaces import QosDurability
    from rosbags.rosbag2 import Reader

    rosbag.write(tmp_path / "bag", recording())
    with Reader(tmp_path / "bag") as reader:
        topics = {c.topic: c for c in reader.connections}
        stamps = [stamp for _, stamp, _ in reader.messages()]
    assert set(topics) == {"/scan", "/ins", "/ground_truth", "/imu", "/tf", "/tf_static"}
    assert topics["/scan"].msgcount == topics["/tf"].msgcount == SCANS
    assert topics["/tf_static"].ext.offered_qos_profiles[0].durability == QosDurability.TRANSIENT_LOCAL
    assert np.all(np.diff(stamps) > 0)


class Bag:
    """A foreign bag, message by message."""

    def __init__(self, path: Path) -> None:
        from rosbags.rosbag2 import Writer
        from rosbags.typesys import Stores, get_typestore

        self.types = get_typestore(Stores.ROS2_HUMBLE)
        self.messages = rosbag.Messages(self.types.types)
        self.writer = Writer(path, version=8)
        self.connections: dict[str, Any] = {}
        self.clock = 0

    def __enter__(self) -> Bag:
        self.writer.open()
        return self

    def __exit__(self, *_: object) -> None:
        self.writer.close()

    def say(self, topic: str, message: Any) -> None:
        kind = message.__msgtype__
        if topic not in self.connections:
            self.connections[topic] = self.writer.add_connection(topic, kind, typestore=self.types)
        self.clock += 1
        self.writer.write(self.connections[topic], self.clock, self.types.serialize_cdr(message, kind))

    def odometry(self, time: float, x: float, topic: str = "/robot/odom") -> None:
        self.say(topic, self.messages.odometry(time, "odom", np.array([x, 0.0, 0.1])))

    def scan(self, time: float, topic: str = "/robot/scan", **changes: Any) -> None:
        given = replace(recording(), time=np.full(SCANS, time))
        message = self.messages.scan(given, 0)
        for name, value in changes.items():
            setattr(message, name, value)
        self.say(topic, message)

    def link(self, parent: str, child: str, pose: tuple[float, float, float], roll: float = 0.0) -> None:
        message = self.messages.tf(0.0, parent, child, np.array(pose))
        if roll:
            w, x, y, z = quaternion.from_angles(roll, 0.0, pose[2])
            message.transforms[0].transform.rotation = self.types.types["geometry_msgs/msg/Quaternion"](
                x, y, z, w
            )
        self.say("/tf_static", message)


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


def refused(path: Path, message: str) -> None:
    with pytest.raises(FormatError, match=message) as caught:
        load(path)
    assert str(caught.value).startswith(str(path))
    assert "\n" not in str(caught.value)


def test_bags_that_say_too_little(tmp_path: Path) -> None:
    with Bag(tmp_path / "empty"):
        pass
    refused(tmp_path / "empty", "no sensor_msgs/msg/LaserScan")
    with Bag(tmp_path / "blind") as bag:
        bag.odometry(1.0, 0.0)
    refused(tmp_path / "blind", "no sensor_msgs/msg/LaserScan")


def test_bags_that_make_no_sense(tmp_path: Path) -> None:
    with Bag(tmp_path / "beams") as bag:
        bag.odometry(1.0, 0.0)
        bag.scan(1.0)
        bag.scan(2.0, ranges=np.ones(4, dtype=np.float32))
    refused(tmp_path / "beams", "scan 2 of 4 ranges, expected 9")
    with Bag(tmp_path / "angles") as bag:
        bag.odometry(1.0, 0.0)
        bag.scan(1.0, angle_min=0.0, angle_max=0.0, angle_increment=0.0)
    refused(tmp_path / "angles", "angles must increase")
    with Bag(tmp_path / "nowhere") as bag:
        bag.odometry(1.0, np.nan)
        bag.scan(1.0)
    refused(tmp_path / "nowhere", "dead_reckoning: expected finite values")
    with Bag(tmp_path / "tilted") as bag:
        bag.link("base_link", "laser", (0.0, 0.0, 0.0), roll=np.pi)
        bag.odometry(1.0, 0.0)
        bag.scan(1.0)
    refused(tmp_path / "tilted", "tilted or upside down")


@pytest.mark.parametrize("storage", ["sqlite3", "mcap"])
def test_damaged_bags(storage: str, tmp_path: Path) -> None:
    rosbag.write(tmp_path / "bag", recording(), storage)
    file = next(p for p in (tmp_path / "bag").iterdir() if p.suffix in (".db3", ".mcap"))
    whole = file.read_bytes()
    for part in (b"", whole[: len(whole) // 2], b"nonsense" * 500):
        file.write_bytes(part)
        refused(tmp_path / "bag", "not a readable ROS 2 bag")
        refused(file, "not a readable ROS 2 bag")
    file.unlink()
    refused(tmp_path / "bag", "not a readable ROS 2 bag")
    (tmp_path / "bag" / "metadata.yaml").write_text("a: [")
    refused(tmp_path / "bag", "not a readable ROS 2 bag")


def test_what_a_bag_cannot_hold(tmp_path: Path) -> None:
    given = recording()
    with pytest.raises(ValueError, match="times >= 0"):
        rosbag.write(tmp_path / "bag", replace(given, time=given.time - 1.0))
    uneven = np.sort(np.random.default_rng(0).uniform(-2.0, 2.0, BEAMS))
    with pytest.raises(ValueError, match="evenly spaced"):
        rosbag.write(tmp_path / "bag", replace(given, angles=uneven))
    assert not (tmp_path / "bag").exists()
    (tmp_path / "bag").mkdir()
    with pytest.raises(FormatError, match="exists already"):
        rosbag.write(tmp_path / "bag", given)


def test_without_rosbags_the_way_to_install_it_is_named(tmp_path: Path) -> None:
    rosbag.write(tmp_path / "bag", recording())
    code = (
        "import sys; sys.modules['rosbags'] = None\n"
        "from slam.formats import load\n"
        f"try: load({str(tmp_path / 'bag')!r})\n"
        "except ValueError as error: print(error)\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip().endswith(
        "a ROS 2 bag needs the package rosbags: pip install 'slamstitch[ros]'"
    )


def test_a_bag_without_odometry_has_no_dead_reckoning(tmp_path: Path) -> None:
    """Its mount leads as far as the transforms do."""
    with Bag(tmp_path / "alone") as bag:
        bag.link("base_link", "laser", (0.2, 0.0, 0.0))
        bag.scan(1.0)
        bag.scan(1.2)
    found = load(tmp_path / "alone")
    assert found.source == "none"
    np.testing.assert_array_equal(found.dead_reckoning, np.zeros((2, 3)))
    np.testing.assert_allclose(found.laser.T_robot_laser, [0.2, 0.0, 0.0], atol=1e-9)


def test_no_dead_reckoning_is_written_as_none(tmp_path: Path) -> None:
    rosbag.write(tmp_path / "bag", recording().without_dead_reckoning())
    assert load(tmp_path / "bag").source == "none"
