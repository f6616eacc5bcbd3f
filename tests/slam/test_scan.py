"""A scan: what of the beams survives, and how it moves from frame to frame."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields, replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from slam import se2
from slam.recording import Laser, Recording
from slam.scan import Scan, ScanConfig, scans_of
from slam.se2 import Array
from slam.surface import correspondence_variance

quick = settings(deadline=None, max_examples=30, derandomize=True)

ANGLES = np.radians(np.arange(-20.0, 21.0))
WALL = 2.0 / np.cos(ANGLES)
"""Ranges to a wall across the laser's view, 2 m ahead."""

FIELDS = ("points", "tangents", "normals", "covariance", "tangent_sigma", "beams")
pose = st.builds(
    lambda x, y, yaw: np.array([x, y, yaw]), st.floats(-20, 20), st.floats(-20, 20), st.floats(-4, 4)
)


def wall_scan() -> Scan:
    return Scan.from_ranges(WALL, ANGLES, Laser())


def assert_same(a: Scan, b: Scan, atol: float = 1e-9) -> None:
    for name in FIELDS:
        np.testing.assert_allclose(getattr(a, name), getattr(b, name), atol=atol, err_msg=name)


def test_a_wall_ahead() -> None:
    scan = wall_scan()
    assert len(scan) == len(ANGLES)
    np.testing.assert_allclose(
        scan.points, np.stack([np.full(41, 2.0), 2.0 * np.tan(ANGLES)], -1), atol=1e-12
    )
    np.testing.assert_allclose(np.abs(scan.tangents), np.tile([0.0, 1.0], (41, 1)), atol=1e-6)
    np.testing.assert_allclose(scan.normals, np.tile([-1.0, 0.0], (41, 1)), atol=1e-6)


def test_covariance_of_the_beam_at_right_angles() -> None:
    laser = Laser(sigma_range=0.02)
    P = Scan.from_ranges(WALL, ANGLES, laser).covariance[20]
    along = (2.0 * ScanConfig.sigma_angle) ** 2 + correspondence_variance(2.0, np.pi / 2, np.radians(1.0))
    np.testing.assert_allclose(P, np.diag([0.02**2, along]), rtol=1e-6, atol=1e-12)


def test_beams_without_return_leave_no_point() -> None:
    ranges = WALL.copy()
    ranges[[0, 7, 20]] = np.nan
    scan = Scan.from_ranges(ranges, ANGLES, Laser())
    np.testing.assert_array_equal(scan.beams, np.setdiff1d(np.arange(41), [0, 7, 20]))
    for name in ("points", "covariance"):
        assert np.all(np.isfinite(getattr(scan, name)))
        assert len(getattr(scan, name)) == 38


def test_a_blind_scan_is_empty() -> None:
    scan = Scan.from_ranges(np.full(41, np.nan), ANGLES, Laser())
    assert len(scan) == 0
    assert scan.points.shape == (0, 2)
    assert scan.covariance.shape == (0, 2, 2)


def test_points_are_in_the_robots_frame() -> None:
    mount = np.array([-0.08, 0.1, np.pi / 2])
    mounted = Scan.from_ranges(WALL, ANGLES, Laser(T_robot_laser=mount))
    # The laser looks to the left: its wall is 2 m to the left of it.
    np.testing.assert_allclose(mounted.points[:, 1], 2.1, atol=1e-12)
    np.testing.assert_allclose(mounted.points[20], [-0.08, 2.1], atol=1e-12)
    np.testing.assert_allclose(mounted.normals, np.tile([0.0, -1.0], (41, 1)), atol=1e-6)
    assert mounted.covariance[20, 1, 1] == pytest.approx(0.01**2)


def test_normals_look_at_the_sensor(room: Array, look: Callable[..., Scan]) -> None:
    scan = look(room, np.array([3.0, 2.0, 0.4]), np.random.default_rng(1))
    known = np.isfinite(scan.normals[:, 0])
    assert np.mean(known) > 0.8
    assert np.all(np.sum(scan.normals * scan.points, axis=1)[known] < 0.0)
    np.testing.assert_allclose(np.linalg.norm(scan.normals[known], axis=1), 1.0)
    np.testing.assert_allclose(np.sum(scan.normals * scan.tangents, axis=1)[known], 0.0, atol=1e-12)
    assert np.all(np.linalg.eigvalsh(scan.covariance) > 0.0)


@pytest.mark.parametrize(
    ("ranges", "angles"), [(np.ones(5), np.zeros(4)), (np.ones((2, 4)), np.zeros((2, 4)))]
)
def test_shapes_that_disagree_are_refused(ranges: Array, angles: Array) -> None:
    with pytest.raises(ValueError, match=r"ranges and angles: expected equal \(B,\)"):
        Scan.from_ranges(ranges, angles, Laser())


@quick
@given(pose)
def test_there_and_back_again(T: Array) -> None:
    scan = wall_scan()
    assert_same(scan.transformed(T).transformed(se2.inverse(T)), scan)


@quick
@given(pose, pose)
def test_two_moves_are_one(a: Array, b: Array) -> None:
    scan = wall_scan()
    assert_same(scan.transformed(b).transformed(a), scan.transformed(se2.compose(a, b)))


def test_a_quarter_turn() -> None:
    scan = wall_scan()
    turned = scan.transformed(np.array([10.0, 0.0, np.pi / 2]))
    np.testing.assert_allclose(turned.points[20], [10.0, 2.0], atol=1e-12)
    np.testing.assert_allclose(turned.normals[20], [0.0, -1.0], atol=1e-6)
    # Directions turn but do not shift, and the covariance turns with them.
    np.testing.assert_allclose(turned.covariance[20], scan.covariance[20][::-1, ::-1], atol=1e-9)
    np.testing.assert_array_equal(turned.tangent_sigma, scan.tangent_sigma)


def test_merged_and_selected() -> None:
    first, second = wall_scan(), wall_scan().transformed(np.array([1.0, 2.0, 0.3]))
    both = Scan.merged([first, second])
    assert len(both) == 82
    assert_same(both.selected(np.arange(41)), first)
    assert_same(both.selected(np.arange(82) >= 41), second)
    assert_same(both.selected(np.array([41, 3])), Scan.merged([second.selected([0]), first.selected([3])]))  # type: ignore[arg-type]


def test_scans_of_a_recording(room: Array, record: Callable[..., Recording]) -> None:
    recording = record(room, [[2.0, 2.0, 0.0], [2.5, 2.0, 0.2]])
    scans = scans_of(recording)
    assert len(scans) == 2
    assert_same(scans[1], Scan.from_ranges(recording.ranges[1], recording.angles, recording.laser))


CHANGED = {
    "neighbourhood": (0.1, "tangent_sigma"),
    "most_neighbours": (2, "tangent_sigma"),
    "least_lost": (0.5, "tangent_sigma"),
    "least_independence": (np.inf, "tangent_sigma"),
    "same_line": (0.3, "points"),
    "same_direction": (0.99999, "points"),
    "least_sigma": (0.05, "covariance"),
    "sigma_angle": (5e-3, "covariance"),
    "no_tangent_incidence": (np.pi / 3.0, "covariance"),
}
"""Every setting, a value that is not the default, and what it must change."""


@pytest.mark.parametrize("name", [field.name for field in fields(ScanConfig)])
def test_every_setting_changes_what_is_read_off(
    name: str, room: Array, record: Callable[..., Recording]
) -> None:
    value, read_off = CHANGED[name]
    recording = record(room, [[2.0, 2.0, 0.3]])
    recording.ranges[0, 1::3] = np.nan
    plain, changed = (
        scans_of(recording, config)[0] for config in (ScanConfig(), replace(ScanConfig(), **{name: value}))
    )
    assert not np.allclose(getattr(plain, read_off), getattr(changed, read_off), rtol=1e-4, equal_nan=True)
