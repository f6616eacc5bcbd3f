"""SE(2): the group's axioms, near the identity and near ±π, and covariances against sampling."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from slam import se2

quick = settings(deadline=None, max_examples=60, derandomize=True)

length = st.floats(-100.0, 100.0)
tiny = st.floats(-1e-7, 1e-7)
near_pi = st.builds(lambda d, side: side * np.pi + d, tiny, st.sampled_from([-1.0, 1.0]))
angle = st.one_of(st.floats(-np.pi, np.pi), tiny, near_pi, st.floats(-50.0, 50.0))
pose = st.builds(lambda x, y, yaw: np.array([x, y, yaw]), st.one_of(length, tiny), length, angle)
tangent = st.builds(
    lambda x, y, yaw: np.array([x, y, yaw]),
    st.one_of(length, tiny),
    length,
    st.one_of(st.floats(-3.14, 3.14), tiny, st.floats(-1e-3, 1e-3)),
)
IDENTITY = np.zeros(3)


def assert_poses_equal(a: np.ndarray, b: np.ndarray, atol: float = 1e-9) -> None:
    np.testing.assert_allclose(a[..., :2], b[..., :2], atol=atol)
    np.testing.assert_allclose(se2.wrap(a[..., 2] - b[..., 2]), 0.0, atol=atol)


def matrix(T: np.ndarray) -> np.ndarray:
    """The homogeneous matrix: the obvious twin of everything here."""
    result = np.eye(3)
    result[:2, :2] = se2.rotation(T[2])
    result[:2, 2] = T[:2]
    return result


def test_known_answers() -> None:
    T = np.array([1.0, 2.0, np.pi / 2])
    assert_poses_equal(se2.compose(T, [3.0, 0.0, np.pi / 2]), np.array([1.0, 5.0, np.pi]))
    assert_poses_equal(se2.inverse(T), np.array([-2.0, 1.0, -np.pi / 2]))
    assert_poses_equal(se2.between(T, [1.0, 5.0, np.pi]), np.array([3.0, 0.0, np.pi / 2]))
    np.testing.assert_allclose(se2.transform(T, [[1.0, 0.0], [0.0, 1.0]]), [[1, 3], [0, 2]], atol=1e-12)
    # Half a turn to the left of radius 1 at unit speed: exp(pi, 0, pi) ends 2 m to the left.
    assert_poses_equal(se2.exp([np.pi, 0.0, np.pi]), np.array([0.0, 2.0, np.pi]))
    np.testing.assert_allclose(se2.path_length([[0, 0, 0], [3, 4, 1], [3, 4, 2], [3, 5, 0]]), [0, 5, 5, 6])


@quick
@given(st.floats(-1e3, 1e3))
def test_wrap_keeps_the_direction_and_lands_in_range(a: float) -> None:
    wrapped = float(se2.wrap(a))
    assert -np.pi <= wrapped < np.pi
    np.testing.assert_allclose([np.cos(wrapped), np.sin(wrapped)], [np.cos(a), np.sin(a)], atol=1e-12)


@pytest.mark.parametrize("turns", [-3, -1, 0, 1, 2])
def test_wrap_at_the_seam(turns: int) -> None:
    assert se2.wrap(np.pi + 2 * np.pi * turns) == pytest.approx(-np.pi)
    assert se2.wrap(-np.pi + 1e-9) == pytest.approx(-np.pi + 1e-9)


@quick
@given(pose, pose)
def test_compose_is_the_matrix_product(T_ab: np.ndarray, T_bc: np.ndarray) -> None:
    np.testing.assert_allclose(matrix(se2.compose(T_ab, T_bc)), matrix(T_ab) @ matrix(T_bc), atol=1e-9)


@quick
@given(pose, pose, pose)
def test_associative(a: np.ndarray, b: np.ndarray, c: np.ndarray) -> None:
    assert_poses_equal(se2.compose(se2.compose(a, b), c), se2.compose(a, se2.compose(b, c)))


@quick
@given(pose)
def test_identity_and_inverse(T: np.ndarray) -> None:
    assert_poses_equal(se2.compose(T, IDENTITY), T)
    assert_poses_equal(se2.compose(IDENTITY, T), T)
    assert_poses_equal(se2.compose(T, se2.inverse(T)), IDENTITY)
    assert_poses_equal(se2.compose(se2.inverse(T), T), IDENTITY)
    assert_poses_equal(se2.inverse(se2.inverse(T)), T)


@quick
@given(pose, pose)
def test_between_undoes_compose(T_ab: np.ndarray, T_bc: np.ndarray) -> None:
    assert_poses_equal(se2.between(T_ab, se2.compose(T_ab, T_bc)), T_bc)


@quick
@given(pose, pose, st.tuples(length, length))
def test_transform_acts_like_the_group(a: np.ndarray, b: np.ndarray, point: tuple[float, float]) -> None:
    once = se2.transform(se2.compose(a, b), [point])
    np.testing.assert_allclose(once, se2.transform(a, se2.transform(b, [point])), atol=1e-9)


@quick
@given(tangent)
def test_log_undoes_exp(xi: np.ndarray) -> None:
    np.testing.assert_allclose(se2.log(se2.exp(xi)), xi, atol=1e-9, rtol=1e-9)


@quick
@given(pose)
def test_exp_undoes_log(T: np.ndarray) -> None:
    assert_poses_equal(se2.exp(se2.log(T)), T)
    assert -np.pi <= se2.log(T)[2] < np.pi


@quick
@given(tangent)
def test_exp_of_the_negative_is_the_inverse(xi: np.ndarray) -> None:
    assert_poses_equal(se2.exp(-xi), se2.inverse(se2.exp(xi)))


@quick
@given(tangent, st.floats(0.0, 1.0))
def test_exp_is_a_one_parameter_group(xi: np.ndarray, s: float) -> None:
    assert_poses_equal(se2.compose(se2.exp(s * xi), se2.exp((1.0 - s) * xi)), se2.exp(xi))


@quick
@given(tangent)
def test_exp_is_the_limit_of_small_steps(xi: np.ndarray) -> None:
    step = np.linalg.matrix_power(matrix(np.array([*(xi[:2] / 2**20), xi[2] / 2**20])), 2**20)
    np.testing.assert_allclose(matrix(se2.exp(xi)), step, atol=1e-3)


@pytest.mark.parametrize("yaw", [0.0, 1e-300, 1e-12, 1e-7, 0.99e-4, 1e-4, 1.01e-4, 1e-3, -0.99e-4, -1.01e-4])
def test_series_and_closed_form_meet(yaw: float) -> None:
    # sin(t)/t and (1 - cos t)/t = 2 sin²(t/2)/t, which does not cancel.
    sinc = np.sinc(yaw / np.pi)
    cosc = np.sin(yaw / 2) * np.sinc(yaw / 2 / np.pi)
    np.testing.assert_allclose(se2.exp([1.0, 0.0, yaw])[:2], [sinc, cosc], rtol=1e-12, atol=1e-12)


@quick
@given(pose, st.builds(lambda v: np.array(v), st.tuples(length, length, st.floats(-1.5, 1.5))))
def test_adjoint_moves_a_tangent_across(T: np.ndarray, xi: np.ndarray) -> None:
    left = se2.compose(T, se2.exp(xi))
    right = se2.compose(se2.exp(se2.adjoint(T) @ xi), T)
    assert_poses_equal(left, right, atol=1e-7)


@quick
@given(pose, pose)
def test_adjoint_is_a_homomorphism(a: np.ndarray, b: np.ndarray) -> None:
    product = se2.adjoint(a) @ se2.adjoint(b)
    np.testing.assert_allclose(se2.adjoint(se2.compose(a, b)), product, atol=1e-9)


def covariance(seed: int, scale: float = 1e-2) -> np.ndarray:
    root = np.random.default_rng(seed).normal(size=(3, 3)) * scale
    return root @ root.T + 1e-8 * np.eye(3)


@quick
@given(pose, pose, st.integers(0, 1000))
def test_covariance_there_and_back(T_ab: np.ndarray, T_bc: np.ndarray, seed: int) -> None:
    P = covariance(seed)
    twice = se2.transport(se2.transport(P, T_ab), se2.inverse(T_ab))
    np.testing.assert_allclose(twice, P, atol=1e-7 * np.abs(se2.adjoint(T_ab)).max() ** 2)
    # Composing with a certain pose and with its inverse changes nothing.
    certain = np.zeros((3, 3))
    along = se2.compose_covariance(P, T_bc, certain)
    back = se2.compose_covariance(along, se2.inverse(T_bc), certain)
    np.testing.assert_allclose(back, P, atol=1e-7 * np.abs(se2.adjoint(T_bc)).max() ** 2)


def sampled(covariance_: np.ndarray, rng: np.random.Generator, count: int = 40_000) -> np.ndarray:
    return rng.multivariate_normal(np.zeros(3), covariance_, size=count)


def assert_covariances_agree(found: np.ndarray, errors: np.ndarray) -> None:
    expected = np.cov(errors.T)
    sd = np.sqrt(np.diag(expected))
    np.testing.assert_allclose(found / np.outer(sd, sd), expected / np.outer(sd, sd), atol=0.04)


def test_composed_covariance_is_that_of_samples() -> None:
    rng = np.random.default_rng(5)
    T_ab, T_bc = np.array([2.0, -1.0, 0.7]), np.array([1.5, 0.5, -2.0])
    P_ab, P_bc = covariance(1), covariance(2)
    samples = se2.compose(
        se2.compose(T_ab, se2.exp(sampled(P_ab, rng))), se2.compose(T_bc, se2.exp(sampled(P_bc, rng)))
    )
    errors = se2.log(se2.between(se2.compose(T_ab, T_bc), samples))
    assert_covariances_agree(se2.compose_covariance(P_ab, T_bc, P_bc), errors)


def test_the_inverse_s_covariance_is_that_of_samples() -> None:
    T_ab, P = np.array([2.0, -1.0, 0.7]), covariance(3)
    samples = se2.inverse(se2.compose(T_ab, se2.exp(sampled(P, np.random.default_rng(6)))))
    errors = se2.log(se2.between(se2.inverse(T_ab), samples))
    assert_covariances_agree(se2.transport(P, T_ab), errors)


def test_body_covariance_of_additive_errors_is_that_of_samples() -> None:
    T, P = np.array([2.0, -1.0, 0.7]), covariance(4)
    samples = T + sampled(P, np.random.default_rng(7))
    assert_covariances_agree(se2.to_body_covariance(T, P), se2.log(se2.between(T, samples)))


def test_agrees_with_gtsam() -> None:
    import gtsam

    rng = np.random.default_rng(8)
    for _ in range(50):
        a, b, xi = rng.normal(size=(3, 3)) * [5.0, 5.0, 1.0]
        pose_a, pose_b = gtsam.Pose2(*a), gtsam.Pose2(*b)
        assert_poses_equal(se2.compose(a, b), xyt(pose_a.compose(pose_b)))
        assert_poses_equal(se2.between(a, b), xyt(pose_a.between(pose_b)))
        assert_poses_equal(se2.compose(a, se2.exp(xi)), xyt(pose_a.retract(xi)))
        np.testing.assert_allclose(se2.adjoint(a), pose_a.AdjointMap(), atol=1e-12)


def xyt(pose: object) -> np.ndarray:
    return np.array([pose.x(), pose.y(), pose.theta()])  # type: ignore[attr-defined]


def test_everything_broadcasts() -> None:
    rng = np.random.default_rng(9)
    a, b = rng.normal(size=(4, 1, 3)), rng.normal(size=(5, 3))
    many = se2.compose(a, b)
    assert many.shape == (4, 5, 3)
    np.testing.assert_array_equal(many[2, 3], se2.compose(a[2, 0], b[3]))
    assert se2.transform(many, rng.normal(size=(7, 2))).shape == (4, 5, 7, 2)
    assert se2.adjoint(many).shape == se2.to_body_covariance(many, np.eye(3)).shape == (4, 5, 3, 3)
    assert se2.compose_covariance(np.eye(3), many, np.eye(3)).shape == (4, 5, 3, 3)
    assert se2.compose(np.zeros((0, 3)), IDENTITY).shape == (0, 3)


@pytest.mark.parametrize("bad", [1.0, [1.0, 2.0], np.zeros((3, 2))])
def test_what_is_no_pose_is_refused(bad: object) -> None:
    for function in (se2.inverse, se2.exp, se2.log, se2.adjoint, se2.path_length):
        with pytest.raises(ValueError, match=r"a pose is \(\.\.\., 3\)"):
            function(bad)  # type: ignore[arg-type]


@quick
@given(pose)
def test_a_rigid_fit_recovers_a_pose(T: np.ndarray) -> None:
    points = np.random.default_rng(0).normal(0.0, 5.0, (20, 2))
    assert_poses_equal(se2.fit_rigid(points, se2.transform(T, points)), T)


def test_no_pose_near_a_rigid_fit_misses_by_less() -> None:
    rng = np.random.default_rng(1)
    source = rng.normal(0.0, 5.0, (30, 2))
    target = se2.transform([1.0, -2.0, 2.5], source) + rng.normal(0.0, 0.3, source.shape)
    best = se2.fit_rigid(source, target)

    def squared(T: np.ndarray) -> float:
        return float(np.sum((se2.transform(T, source) - target) ** 2))

    assert all(squared(best) < squared(best + 1e-3 * step) for step in rng.normal(size=(200, 3)))


def test_a_rigid_fit_follows_its_weights() -> None:
    rng = np.random.default_rng(2)
    T, source = np.array([1.0, 2.0, 0.7]), rng.uniform(-5.0, 5.0, (20, 2))
    target = se2.transform(T, source)
    target[10:] += 5.0
    weights = np.where(np.arange(20) < 10, 1.0, 1e-12)
    assert_poses_equal(se2.fit_rigid(source, target, weights), T)


@pytest.mark.parametrize("shape", [(0, 2), (4, 3), (4,)])
def test_a_rigid_fit_refuses_what_are_no_points(shape: tuple[int, ...]) -> None:
    with pytest.raises(ValueError, match="rigid fit"):
        se2.fit_rigid(np.zeros(shape), np.zeros(shape))
