"""What a recorded increment predicts, and how far it is believed."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import ArrayLike

from slam import se2
from slam.odometry.dead_reckoning import DeadReckoning
from slam.recording import Laser, Recording
from slam.se2 import Array

quick = settings(deadline=None, max_examples=40, derandomize=True)

pose = st.builds(
    lambda x, y, yaw: np.array([x, y, yaw]), st.floats(-20, 20), st.floats(-20, 20), st.floats(-3.1, 3.1)
)
SOURCES = ("ins", "odometry")


def reckoned(poses: ArrayLike, source: str) -> Recording:
    at = np.array(poses)
    n = len(at)
    return Recording("test", np.arange(n), np.ones((n, 1)), np.zeros(1), Laser(), at, source)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("source", "expected"), [("ins", [11.0, 5.0, 1.67]), ("odometry", [10.0, 6.0, 1.67])]
)
def test_a_robot_whose_yaw_is_off_by_a_quarter_turn(source: str, expected: list[float]) -> None:
    recording = reckoned([[0.0, 0.0, 0.0], [1.0, 0.0, 0.1]], source)
    before = np.array([10.0, 5.0, 1.57])
    np.testing.assert_allclose(DeadReckoning(recording).predict(0, 1, before), expected, atol=1e-3)


@pytest.mark.parametrize("source", SOURCES)
@quick
@given(pose, pose)
def test_from_the_recorded_pose_it_predicts_the_recorded_pose(source: str, a: Array, b: Array) -> None:
    found = DeadReckoning(reckoned([a, b], source)).predict(0, 1, a)
    np.testing.assert_allclose(se2.log(se2.between(b, found)), 0.0, atol=1e-9)


@pytest.mark.parametrize("source", SOURCES)
def test_the_predicted_yaw_is_wrapped(source: str) -> None:
    recording = reckoned([[0.0, 0.0, 3.0], [0.0, 0.0, -3.0]], source)
    assert DeadReckoning(recording).predict(0, 1, np.array([0.0, 0.0, 3.0]))[2] == pytest.approx(-3.0)


@quick
@given(pose, pose)
def test_prediction_by_odometry_moves_with_the_frame(frame: Array, step: Array) -> None:
    recording = reckoned([np.array([1.0, 2.0, 0.5]), se2.compose([1.0, 2.0, 0.5], step)], "odometry")
    here = DeadReckoning(recording).predict(0, 1, np.zeros(3))
    there = DeadReckoning(recording).predict(0, 1, frame)
    np.testing.assert_allclose(se2.log(se2.between(se2.compose(frame, here), there)), 0.0, atol=1e-9)


@pytest.mark.parametrize("source", SOURCES)
@pytest.mark.parametrize(
    ("step", "grows"),
    [([1.0, 0.0, 0.0], (0, 1)), ([0.0, 0.0, 1.0], (2,)), ([1.0, 0.0, 1.0], (0, 1, 2))],
)
def test_more_motion_is_less_certain(source: str, step: list[float], grows: tuple[int, ...]) -> None:
    rest, moved = (
        np.diag(DeadReckoning(reckoned([np.zeros(3), np.array(s)], source)).step_covariance(0, 1))
        for s in ([0.0, 0.0, 0.0], step)
    )
    assert np.all(rest > 0.0)
    assert np.all(moved >= rest)
    assert all(moved[k] > rest[k] for k in grows)


def test_known_variances() -> None:
    walk = [[0.0, 0.0, 1.0], [0.0, 2.0, 1.0]]
    np.testing.assert_allclose(
        np.diag(DeadReckoning(reckoned(walk, "ins")).step_covariance(0, 1)), [1.018e-3, 1.018e-3, 3.6e-5]
    )
    turn = [[0.0, 0.0, 0.0], [0.0, 0.0, 0.5]]
    np.testing.assert_allclose(
        np.diag(DeadReckoning(reckoned(turn, "odometry")).step_covariance(0, 1)),
        [1e-4, 1e-4, 1e-4 + 0.05**2],
    )


def test_wheels_slip_sideways_in_the_map_frame_where_the_robot_looks() -> None:
    recording = reckoned([[0.0, 0.0, 0.0], [1.0, 0.0, 1.0]], "odometry")
    along, side, _ = np.diag(DeadReckoning(recording).step_covariance(0, 1))
    assert side > 2.0 * along
    looking_up = DeadReckoning(recording).map_covariance(0, 1, np.array([5.0, 5.0, np.pi / 2]))
    np.testing.assert_allclose(np.diag(looking_up)[:2], [side, along])


@quick
@given(pose)
def test_body_covariance_of_odometry_does_not_know_the_pose(where: Array) -> None:
    recording = reckoned([[0.0, 0.0, 0.0], [1.0, 0.2, 0.4]], "odometry")
    found = DeadReckoning(recording).body_covariance(0, 1, where)
    np.testing.assert_allclose(found, DeadReckoning(recording).step_covariance(0, 1), atol=1e-15)


def test_map_covariance_of_odometry_is_that_of_samples() -> None:
    recording = reckoned([[0.0, 0.0, 0.0], [1.0, 0.0, 0.5]], "odometry")
    before = np.array([3.0, 1.0, 2.0])
    after = DeadReckoning(recording).predict(0, 1, before)
    P = DeadReckoning(recording).step_covariance(0, 1)
    noise = np.random.default_rng(1).multivariate_normal(np.zeros(3), P, 40_000)
    errors = se2.compose(after, se2.exp(noise)) - after
    expected = np.cov(errors.T)
    sd = np.sqrt(np.diag(expected))
    found = DeadReckoning(recording).map_covariance(0, 1, after)
    np.testing.assert_allclose(found / np.outer(sd, sd), expected / np.outer(sd, sd), atol=0.04)


def test_simulated_ins_errors_fit_the_model(room: Array, record: Callable[..., Recording]) -> None:
    # An INS that wanders as the model says: its steps' normalised errors average one.
    rng = np.random.default_rng(2)
    truth = np.column_stack([2.0 + 0.05 * np.arange(400) % 4.0, np.full(400, 3.0), np.zeros(400)])
    exact = record(room, truth, source="ins")
    steps = np.array([DeadReckoning(exact).step_covariance(k, k + 1) for k in range(399)])
    noise = np.einsum("kab,kb->ka", np.linalg.cholesky(steps), rng.normal(size=(399, 3)))
    drifted = record(room, truth, truth + np.vstack([np.zeros(3), np.cumsum(noise, axis=0)]), source="ins")
    errors = [DeadReckoning(drifted).predict(k, k + 1, truth[k]) - truth[k + 1] for k in range(399)]
    nees = np.mean([e @ np.linalg.solve(P, e) for e, P in zip(errors, steps, strict=True)]) / 3.0
    assert nees == pytest.approx(1.0, abs=0.15)


def test_without_dead_reckoning_the_robot_stands_the_less_surely_the_longer() -> None:
    n = 6
    recording = Recording(
        "r", 0.5 * np.arange(n), np.ones((n, 3)), np.arange(3), Laser(), np.zeros((n, 3)), "none"
    )
    pose = np.array([1.0, 2.0, 0.5])
    np.testing.assert_array_equal(DeadReckoning(recording).predict(0, 3, pose), pose)
    one, three = (DeadReckoning(recording).step_covariance(0, k) for k in (1, 3))
    np.testing.assert_allclose(one, np.diag([0.25, 0.25, 0.25]) ** 2)
    np.testing.assert_allclose(three, 9.0 * one)
    assert DeadReckoning(recording).step_covariance(2, 2)[0, 0] > 0.0
    lost = [DeadReckoning(recording).lost_covariance(0, k - 1, k, pose) for k in range(1, n)]
    np.testing.assert_allclose(sum(lost), DeadReckoning(recording).step_covariance(0, n - 1), atol=1e-12)
