"""What holds of every kind of corruption, also of one that is added later."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from sim.corruption import CORRUPTIONS, Kind, corrupt
from slam.formats import recording_npz
from slam.recording import Odometry, Recording, Relations
from slam.se2 import Array

SIXTY = np.arange(60)
LEVELS = [one for kind in CORRUPTIONS.values() for _, one in kind.levels()]


@pytest.fixture(scope="module")
def drive(record: Callable[..., Recording], room: Array) -> Recording:
    """Sixty scans with everything that a recording can hold."""
    turned = SIXTY / 12.0
    poses = np.column_stack([3.5 + 0.8 * np.sin(turned), 3.0 - 0.8 * np.cos(turned), turned])
    rows = np.repeat(SIXTY, 2)
    full_rate = Odometry(0.1 * np.arange(120.0), poses[rows], 2 * SIXTY)
    relations = Relations(np.array([[0.0, 1.0]]), np.array([[0.5, 0.0, 0.1]]))
    tilt = 0.02 * np.column_stack([np.sin(turned), np.cos(turned)])
    return record(room, poses, odometry=full_rate, relations=relations, attitude=tilt)


def same(a: Recording, b: Recording, *names: str) -> bool:
    return all(np.array_equal(getattr(a, name), getattr(b, name), equal_nan=True) for name in names)


@pytest.mark.parametrize("corruption", LEVELS, ids=str)
def test_it_spoils_what_it_says_and_nothing_that_poses_are_scored_by(corruption, drive) -> None:
    if corruption.kind.name == "odometry.frozen":
        corruption = corruption.kind.at(2)  # as many as sixty scans have room for
    spoilt = corrupt(drive, [corruption], np.random.default_rng(1))
    if corruption.kind.name.startswith("odometry."):
        assert same(spoilt, drive, "ranges", "angles", "attitude")
        assert spoilt.source != drive.source or not same(spoilt, drive, "dead_reckoning")
        assert spoilt.laser is drive.laser
    elif corruption.kind.name != "laser.time":
        assert same(spoilt, drive, "dead_reckoning", "attitude")
        assert spoilt.source == drive.source
        assert spoilt.ranges.shape != drive.ranges.shape or not (
            same(spoilt, drive, "ranges") and np.all(spoilt.laser.T_robot_laser == drive.laser.T_robot_laser)
        )
    assert same(spoilt, drive, "time", "truth")
    assert spoilt.odometry is drive.odometry
    assert spoilt.relations is drive.relations
    assert spoilt.corruptions == (str(corruption),)


@pytest.mark.parametrize("kind", CORRUPTIONS.values(), ids=lambda kind: kind.name)
def test_the_generator_alone_decides(kind: Kind, drive) -> None:
    corruption = kind.at(2) if kind.name == "odometry.frozen" else kind.at()
    names = ("ranges", "angles", "dead_reckoning", "attitude")
    first, again, other = (corrupt(drive, [corruption], np.random.default_rng(k)) for k in (3, 3, 4))
    assert same(first, again, *names)
    assert np.array_equal(first.laser.T_robot_laser, again.laser.T_robot_laser)
    alike = same(first, other, *names)
    alike &= np.array_equal(first.laser.T_robot_laser, other.laser.T_robot_laser)
    assert alike != kind.drawn


@pytest.mark.parametrize("kind", CORRUPTIONS.values(), ids=lambda kind: kind.name)
def test_without_dead_reckoning_there_is_none_to_spoil(kind: Kind, drive) -> None:
    laser_alone = drive.without_dead_reckoning()
    corruption = kind.at(2) if kind.name == "odometry.frozen" else kind.at()
    if kind.needs_dead_reckoning:
        with pytest.raises(ValueError, match=rf"{kind.name}.*: the recording has no dead reckoning"):
            corruption.apply(laser_alone, np.random.default_rng(0))
    else:
        assert corruption.apply(laser_alone, np.random.default_rng(0)).source == "none"


@pytest.mark.parametrize("kind", [k for k in CORRUPTIONS.values() if k.severity], ids=lambda k: k.name)
def test_severities_have_limits(kind: Kind) -> None:
    much = kind.severity
    assert much is not None
    for value in (much.default, *much.levels, much.least, much.most):
        assert kind.at(value).severity == value
    for value in (much.least - 1.0, 2.0 * much.most + 1.0, np.nan, *([1.5] if much.whole else [])):
        with pytest.raises(ValueError, match=rf"{kind.name}: expected a .*number from .*got"):
            kind.at(value)


def test_what_is_there_or_not_has_no_severity() -> None:
    with pytest.raises(ValueError, match="expected no severity"):
        CORRUPTIONS["odometry.sign"].at(1.0)


@pytest.mark.parametrize("words", [("odometry.frozen", 9), ("odometry.late", 60), ("odometry.jumps", 60)])
def test_short_recordings_are_refused(words, drive) -> None:
    name, severity = words
    with pytest.raises(ValueError, match=f"{name}={severity}: expected .*scans, got 60"):
        CORRUPTIONS[name].at(severity).apply(drive, np.random.default_rng(0))


def test_several_go_one_after_the_other(drive) -> None:
    jumps, rounded = CORRUPTIONS["odometry.jumps"].at(1), CORRUPTIONS["odometry.quantised"].at(0.5)
    last = corrupt(drive, [jumps, rounded], np.random.default_rng(0))
    first = corrupt(drive, [rounded, jumps], np.random.default_rng(0))
    assert last.corruptions == ("odometry.jumps=1", "odometry.quantised=0.5")
    assert np.allclose(last.dead_reckoning[:, :2] % 0.5, 0.0)
    assert not np.allclose(first.dead_reckoning[:, :2] % 0.5, 0.0)


def test_a_file_keeps_what_was_spoilt(drive, tmp_path) -> None:
    spoilt = corrupt(drive, [CORRUPTIONS["odometry.late"].at(1)], np.random.default_rng(0))
    recording_npz.write(tmp_path / "spoilt.npz", spoilt)
    back = recording_npz.read(tmp_path / "spoilt.npz")
    assert back.corruptions == ("odometry.late=1",)
    assert same(back, spoilt, "dead_reckoning")
    assert back.odometry is not None
    assert back.full_rate is None  # which is what other formats write
    assert replace(back, corruptions=()).full_rate is back.odometry
