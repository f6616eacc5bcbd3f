"""Keyframes: which scans stand for the drive, and how a correction reaches those between them."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from slam import se2
from slam.mapping import keyframes
from slam.mapping.keyframes import KeyframeConfig
from slam.se2 import Array

quick = settings(deadline=None, max_examples=40, derandomize=True)

frame = st.builds(
    lambda x, y, yaw: np.array([x, y, yaw]), st.floats(-20, 20), st.floats(-20, 20), st.floats(-3, 3)
)


def straight(n: int, step: float = 0.1) -> Array:
    return np.column_stack([step * np.arange(n), np.zeros(n), np.zeros(n)])


def drive(seed: int, n: int = 60) -> Array:
    """A random walk with stops."""
    rng = np.random.default_rng(seed)
    steps = np.column_stack([np.full(n, 0.05), np.zeros(n), rng.normal(0.0, 0.1, n)])
    steps[rng.random(n) < 0.2] = 0.0
    poses: list[Array] = [np.zeros(3)]
    for step in steps[1:]:
        poses.append(se2.compose(poses[-1], step))
    return np.array(poses)


def assert_same(a: Array, b: Array, atol: float = 1e-9) -> None:
    np.testing.assert_allclose(se2.log(se2.between(a, b)), 0.0, atol=atol)


def test_known_choices() -> None:
    np.testing.assert_array_equal(keyframes.choose(straight(11), KeyframeConfig(0.25, 1.0)), [0, 3, 6, 9, 10])
    turning = np.column_stack([np.zeros(7), np.zeros(7), np.radians(4.0) * np.arange(7)])
    np.testing.assert_array_equal(
        keyframes.choose(turning, KeyframeConfig(1.0, np.radians(7.0))), [0, 2, 4, 6]
    )
    np.testing.assert_array_equal(keyframes.choose(np.zeros((4, 3))), [0, 3])
    np.testing.assert_array_equal(keyframes.choose(np.zeros((1, 3))), [0])


@pytest.mark.parametrize("seed", range(5))
def test_chosen_ones_are_apart_and_the_rest_is_near(seed: int) -> None:
    poses = drive(seed)
    rows = keyframes.choose(poses, KeyframeConfig(0.15, 0.2))
    assert rows[0] == 0
    assert rows[-1] == len(poses) - 1
    assert np.all(np.diff(rows) > 0)
    for k in range(len(poses)):
        step = se2.between(poses[rows[rows <= k][-1]], poses[k])
        far = np.hypot(*step[:2]) >= 0.15 or abs(step[2]) >= 0.2
        assert not far
    steps = se2.between(poses[rows[:-2]], poses[rows[1:-1]])
    assert np.all((np.hypot(steps[:, 0], steps[:, 1]) >= 0.15) | (np.abs(steps[:, 2]) >= 0.2))


@pytest.mark.parametrize("seed", range(3))
def test_nothing_corrected_is_nothing_moved(seed: int) -> None:
    poses = drive(seed)
    rows = keyframes.choose(poses)
    assert_same(keyframes.carry(poses, rows, poses[rows]), poses)


@quick
@given(frame, st.integers(0, 5))
def test_a_rigid_correction_moves_all_alike(T: Array, seed: int) -> None:
    poses = drive(seed)
    rows = np.array([5, 20, 41])
    assert_same(keyframes.carry(poses, rows, se2.compose(T, poses[rows])), se2.compose(T, poses))


def test_the_corrected_ones_are_taken_over() -> None:
    poses = drive(1)
    rows = keyframes.choose(poses)
    corrected = se2.compose(poses[rows], np.random.default_rng(2).normal(0.0, 0.1, (len(rows), 3)))
    np.testing.assert_array_equal(keyframes.carry(poses, rows, corrected)[rows], corrected)


def test_a_correction_is_spread_along_the_path() -> None:
    poses = straight(11)
    corrected = np.array([[0.0, 0.0, 0.0], [1.0, 0.5, 0.0]])
    carried = keyframes.carry(poses, np.array([0, 10]), corrected)
    np.testing.assert_allclose(carried[:, 0], poses[:, 0], atol=1e-9)
    np.testing.assert_allclose(carried[:, 1], 0.05 * np.arange(11), atol=1e-6)


def test_before_the_first_and_after_the_last_follow_rigidly() -> None:
    poses = straight(11)
    corrected = np.array([[0.3, 1.0, 0.0], [0.7, 1.0, np.pi / 2]])
    carried = keyframes.carry(poses, np.array([3, 7]), corrected)
    np.testing.assert_allclose(carried[:3], poses[:3] + np.array([0.0, 1.0, 0.0]), atol=1e-9)
    np.testing.assert_allclose(carried[8:], [[0.7, 1.0 + d, np.pi / 2] for d in (0.1, 0.2, 0.3)], atol=1e-9)


def test_at_rest_a_correction_is_spread_over_the_scans() -> None:
    poses = np.zeros((5, 3))
    carried = keyframes.carry(poses, np.array([0, 4]), np.array([[0.0, 0.0, 0.0], [0.4, 0.0, 0.0]]))
    np.testing.assert_allclose(carried[:, 0], [0.0, 0.1, 0.2, 0.3, 0.4], atol=1e-6)


@pytest.mark.parametrize("rows", [[0], [0, 1], [0, 4, 5, 11], [3, 7]])
def test_nearest_against_looking_at_all(rows: list[int]) -> None:
    n = 12
    found = keyframes.nearest(np.array(rows), n)
    apart = np.abs(np.array(rows)[found] - np.arange(n))
    np.testing.assert_array_equal(apart, [min(abs(k - row) for row in rows) for k in range(n)])
