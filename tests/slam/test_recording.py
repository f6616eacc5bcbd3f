"""Recordings: what is refused, what is copied, how far it is."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from slam import se2
from slam.recording import Laser, Odometry, Recording, Relations


def recording(n: int = 3, beams: int = 4, **changes: Any) -> Recording:
    fields: dict[str, Any] = {
        "name": "r",
        "time": np.arange(n),
        "ranges": np.ones((n, beams)),
        "angles": np.linspace(-1, 1, beams),
        "laser": Laser(),
        "dead_reckoning": np.zeros((n, 3)),
    }
    return Recording(**(fields | changes))


@settings(max_examples=50, deadline=None, derandomize=True)
@given(st.integers(1, 20), st.integers(1, 30), st.integers(0, 2**32 - 1))
def test_any_agreeing_shapes_are_taken(n: int, beams: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    ranges = rng.uniform(0, 9, (n, beams))
    ranges[rng.random((n, beams)) < 0.3] = np.nan
    poses = rng.normal(size=(n, 3))
    r = recording(n, beams, ranges=ranges, truth=poses, attitude=poses[:, :2], time=rng.normal(size=n))
    assert len(r) == n
    np.testing.assert_array_equal(r.ranges, ranges)
    assert r.distance == pytest.approx(se2.path_length(poses)[-1])
    assert all(array.dtype == np.float64 for array in (r.time, r.ranges, r.angles, r.truth))


@settings(max_examples=50, deadline=None, derandomize=True)
@given(
    st.sampled_from(["time", "ranges", "dead_reckoning", "truth", "attitude"]),
    st.sampled_from([np.nan, np.inf, -np.inf]),
    st.integers(0, 2),
)
def test_only_ranges_may_be_missing(name: str, value: float, row: int) -> None:
    shapes = {"time": (3,), "ranges": (3, 4), "dead_reckoning": (3, 3), "truth": (3, 3), "attitude": (3, 2)}
    array = np.ones(shapes[name])
    array[row] = value
    if name == "ranges":
        assert np.array_equal(recording(ranges=array).ranges, array, equal_nan=True)
    else:
        with pytest.raises(ValueError, match=f"{name}: expected finite values"):
            recording(**{name: array})


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"time": np.zeros(0)}, "at least one scan"),
        ({"time": np.zeros(2)}, r"ranges: expected shape \(2, 4\), got \(3, 4\)"),
        ({"ranges": np.ones((3, 5))}, r"ranges: expected shape \(3, 4\), got \(3, 5\)"),
        ({"dead_reckoning": np.ones((3, 2))}, "dead_reckoning: expected shape"),
        ({"truth": np.ones((2, 3))}, "truth: expected shape"),
        ({"attitude": np.ones((3, 3))}, "attitude: expected shape"),
        ({"angles": np.array([1.0, 0.5, 0.0, -0.5])}, "angles must increase"),
        ({"angles": np.array([0.0, 0.5, 0.5, 1.0])}, "angles must increase"),
        ({"source": "gps"}, "source: expected one of"),
        ({"odometry": Odometry(np.zeros(2), np.zeros((2, 3)), np.zeros(2))}, "scan_row: expected 3 rows"),
    ],
)
def test_what_disagrees_is_refused(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        recording(**changes)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"range_min": -0.1}, "laser limits"),
        ({"range_min": 5.0, "range_max": 5.0}, "laser limits"),
        ({"range_max": np.nan}, "laser limits"),
        ({"sigma_range": 0.0}, "laser noise"),
        ({"sigma_range": np.nan}, "laser noise"),
        ({"T_robot_laser": np.zeros(2)}, "T_robot_laser: expected shape"),
    ],
)
def test_impossible_lasers_are_refused(arguments: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Laser(**arguments)


@pytest.mark.parametrize("row", [-1, 2])
def test_odometry_rows_must_exist(row: int) -> None:
    with pytest.raises(ValueError, match=r"scan_row: expected rows in 0\.\.1"):
        Odometry(np.zeros(2), np.zeros((2, 3)), np.array([row]))


def test_relations_must_pair_up() -> None:
    with pytest.raises(ValueError, match="relation poses: expected shape"):
        Relations(np.zeros((2, 2)), np.zeros((3, 3)))


def test_distance_is_along_the_truth_where_there_is_one() -> None:
    line = np.array([[0.0, 0, 0], [3, 4, 0], [3, 4, 1]])
    assert recording(dead_reckoning=line).distance == 5.0
    assert recording(dead_reckoning=line, truth=2 * line).distance == 10.0


def test_changes_make_another_recording() -> None:
    r = recording()
    moved = r.with_laser_mount(np.array([-0.04, 0, 0]))
    assert moved.laser.T_robot_laser.tolist() == [-0.04, 0, 0]
    assert r.laser.T_robot_laser.tolist() == [0, 0, 0]
    relations = Relations(np.zeros((1, 2)), np.zeros((1, 3)))
    assert r.with_relations(relations).relations is relations
    assert r.relations is None
    with pytest.raises(dataclasses.FrozenInstanceError):
        r.name = "other"  # type: ignore[misc]


def test_two_lasers_do_not_share_a_mount() -> None:
    assert Laser().T_robot_laser is not Laser().T_robot_laser


def test_no_dead_reckoning_is_one_pose() -> None:
    poses = np.array([[0, 0, 0], [3, 4, 0], [3, 4, 1]], dtype=float)
    with pytest.raises(ValueError, match="dead_reckoning: expected one pose for all scans"):
        recording(dead_reckoning=poses, source="none")
    without = recording(dead_reckoning=poses, truth=poses).without_dead_reckoning()
    assert without.source == "none"
    np.testing.assert_array_equal(without.dead_reckoning, np.zeros((3, 3)))
    np.testing.assert_array_equal(without.truth, poses)
