"""ROS bags: ours read back, damaged ones, and what happens without the package rosbags."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from slam import se2
from slam.formats import FormatError, load
from slam.recording import Odometry, Recording

pytest.importorskip("rosbags", reason="ROS 2 bags need the package rosbags: pip install 'slamstitch[ros]'")

from slam.formats.rosbag import writer as rosbag
from tests.slam.formats.bags import BEAMS, SCANS, Bag, recording, refused


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


def test_topics_are_for_bags_only(tmp_path: Path) -> None:
    from slam.formats import recording_npz

    recording_npz.write(tmp_path / "a.npz", recording())
    with pytest.raises(FormatError, match="has no topics, expected a ROS bag"):
        load(tmp_path / "a.npz", topic="/scan")


# Files


@pytest.mark.parametrize("storage", ["sqlite3", "mcap"])
def test_a_folder_without_metadata_is_read_by_its_files(storage: str, tmp_path: Path) -> None:
    rosbag.write(tmp_path / "bag", recording(), storage)
    (tmp_path / "bag" / "metadata.yaml").unlink()
    assert_same(load(tmp_path / "bag"), recording())


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
    assert done.stdout.strip().endswith("a ROS bag needs the package rosbags: pip install 'slamstitch[ros]'")


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


@pytest.mark.parametrize("nest", [b"[", b"{", b'{"a":', b"- "])
def test_metadata_that_is_nested_deeply_is_refused_at_once(nest: bytes, tmp_path: Path) -> None:
    """YAML would take seconds, and much memory, to say so itself."""
    rosbag.write(tmp_path / "bag", recording())
    metadata = tmp_path / "bag" / "metadata.yaml"
    metadata.write_bytes(metadata.read_bytes() + b"\nmore: " + 5000 * nest)
    with pytest.raises(FormatError, match=r"metadata\.yaml is nested too deeply; try ros2 bag reindex bag"):
        load(tmp_path / "bag")
