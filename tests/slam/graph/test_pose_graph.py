"""The pose graph: against false loops, for an INS whose yaw drifts, and what it refuses."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from slam import se2
from slam.graph.gauss_newton import marginals
from slam.graph.pose_graph import (
    GncConfig,
    PoseGraph,
    WorldSteps,
    anchors,
    chi_squared,
    informations,
    optimise,
)
from slam.se2 import Array

Rms = Callable[[Array, Array], float]

SIGMAS = np.array([0.03, 0.02, np.radians(1.0)])
LOOP_SIGMAS = np.array([0.03, 0.03, np.radians(0.5)])


def square(n: int = 60) -> Array:
    """True poses ``(n, 3)`` on two laps round a square, 1 m apart."""
    pose: Array = np.zeros(3)
    poses = []
    for k in range(n):
        poses.append(pose)
        turn = np.pi / 2 if k % 7 == 6 else 0.0
        pose = se2.compose(pose, [1.0, 0.0, turn])
    return np.array(poses)


def chain(steps: Array, information: Array, first: Array) -> PoseGraph:
    """Graph of steps ``(n - 1, 3)``, its poses strung together from the first."""
    poses = [first]
    for step in steps:
        poses.append(se2.compose(poses[-1], step))
    k = np.arange(len(steps))
    return PoseGraph(
        np.array(poses), np.stack([k, k + 1], -1), steps, np.tile(information, (len(steps), 1, 1))
    )


def noisy_square(seed: int = 0) -> tuple[Array, PoseGraph]:
    rng = np.random.default_rng(seed)
    truth = square()
    steps = se2.compose(
        se2.between(truth[:-1], truth[1:]), se2.exp(rng.normal(size=(len(truth) - 1, 3)) * SIGMAS)
    )
    return truth, chain(steps, np.diag(SIGMAS**-2), truth[0])


def with_loops(
    graph: PoseGraph, truth: Array, good: list[tuple[int, int]], false: list[tuple[int, int]]
) -> PoseGraph:
    """Loops between poses as they truly are, and between poses that are claimed to be one."""
    rng = np.random.default_rng(9)
    pairs = np.array(good + false)
    T = se2.between(truth[pairs[:, 0]], truth[pairs[:, 1]])
    T[len(good) :] = 0.0
    T = se2.compose(T, se2.exp(rng.normal(size=T.shape) * LOOP_SIGMAS))
    return graph.with_loops(pairs, T, np.tile(np.diag(LOOP_SIGMAS**-2), (len(pairs), 1, 1)))


GOOD = [(0, 28), (7, 35), (20, 48)]
FALSE = [(3, 18), (10, 40), (15, 55)]


def test_from_far_off_the_lowest_cost_is_found_all_the_same() -> None:
    """Levenberg-Marquardt alone ends elsewhere from any of these starts."""
    truth, odometry = noisy_square()
    graph = with_loops(odometry, truth, [(k, k + 28) for k in range(0, 32, 4)], [])
    graph = replace(graph, loop=np.zeros(len(graph.edges), dtype=bool))
    best = chi_squared(graph, optimise(graph).poses).sum()
    rng = np.random.default_rng(0)
    for astray in (np.zeros_like(truth), rng.normal(0.0, 50.0, truth.shape)):
        solution = optimise(replace(graph, poses=astray))
        assert chi_squared(graph, solution.poses).sum() == pytest.approx(best, rel=1e-3)
        assert not solution.note


def test_a_cost_that_did_not_go_down_is_told() -> None:
    truth, odometry = noisy_square()
    graph = with_loops(odometry, truth, [(0, 28), (7, 35)], [])
    graph = replace(graph, loop=np.zeros(len(graph.edges), dtype=bool))
    settled = optimise(graph)
    assert not settled.note
    again = replace(graph, poses=optimise(replace(graph, poses=settled.poses)).poses)
    assert "the cost did not go down" in optimise(again).note


def test_an_edge_that_ends_where_it_begins_is_refused() -> None:
    with pytest.raises(ValueError, match="the end of edge 4-4 is not another node"):
        optimise(noisy_square()[1].with_loops(np.array([[4, 4]]), np.zeros((1, 3)), np.eye(3)[None]))


def test_parts_that_nothing_connects_keep_their_first_pose() -> None:
    """Two pieces of a drive; an edge that knows nothing connects nothing."""
    truth, odometry = noisy_square(1)
    information = odometry.information.copy()
    information[29] = 0.0
    apart = replace(odometry, information=information, poses=truth)
    assert anchors(apart) == [0, 30]
    poses = optimise(apart).poses
    np.testing.assert_allclose(poses[[0, 30]], truth[[0, 30]], atol=1e-6)
    np.testing.assert_allclose(chi_squared(apart, poses), 0.0, atol=1e-9)


def test_gnc_keeps_the_good_loops_and_drops_the_false(rms: Rms) -> None:
    truth, odometry = noisy_square()
    graph = with_loops(odometry, truth, GOOD, FALSE)
    robust, plain = optimise(graph), optimise(graph, "none")
    np.testing.assert_allclose(robust.weights, [1, 1, 1, 0, 0, 0], atol=1e-3)
    np.testing.assert_array_equal(plain.weights, np.ones(6))
    before, after = rms(graph.poses, truth), rms(robust.poses, truth)
    assert after < 0.5 * before
    assert after < 0.1 * rms(plain.poses, truth)
    # The false loops cost the robust solution nothing.
    without = optimise(with_loops(odometry, truth, GOOD, []))
    np.testing.assert_allclose(robust.poses[:, :2], without.poses[:, :2], atol=1e-3)


def test_without_false_loops_both_losses_agree() -> None:
    truth, odometry = noisy_square()
    graph = with_loops(odometry, truth, GOOD, [])
    np.testing.assert_allclose(optimise(graph).poses, optimise(graph, "none").poses, atol=1e-4)


def test_a_stricter_gnc_rejects_true_loops_too() -> None:
    truth, odometry = noisy_square()
    graph = with_loops(odometry, truth, GOOD, [])
    strict = optimise(graph, gnc=GncConfig(inlier_probability=1e-6))
    assert np.sum(strict.weights > 0.5) < len(GOOD)


def test_a_graph_without_loops_is_its_odometry() -> None:
    _, odometry = noisy_square()
    solution = optimise(odometry)
    np.testing.assert_allclose(se2.log(se2.between(odometry.poses, solution.poses)), 0.0, atol=1e-6)
    assert solution.weights.shape == (0,)


def test_a_single_pose() -> None:
    nothing = np.zeros((0, 2), dtype=np.int64)
    alone = PoseGraph(np.array([[1.0, 2.0, 0.5]]), nothing, np.zeros((0, 3)), np.zeros((0, 3, 3)))
    np.testing.assert_allclose(optimise(alone).poses, alone.poses, atol=1e-12)


def test_the_first_pose_stays() -> None:
    truth, odometry = noisy_square()
    graph = with_loops(odometry, truth, GOOD, FALSE)
    moved = replace(graph, poses=se2.compose([5.0, -3.0, 2.0], graph.poses))
    solution, here = optimise(moved).poses, optimise(graph).poses
    np.testing.assert_allclose(solution[0], moved.poses[0], atol=1e-3)
    np.testing.assert_allclose(
        se2.log(se2.between(se2.compose([5.0, -3.0, 2.0], here), solution)), 0.0, atol=5e-3
    )


def test_a_singular_edge_says_nothing_along_its_weak_direction() -> None:
    # Odometry says 1 m; a corridor match says 1.2 m along and 0.1 m across, but knows the latter only.
    odometry = chain(np.array([[1.0, 0.0, 0.0]]), np.diag([1e2, 1e2, 1e4]), np.zeros(3))
    match = PoseGraph(
        odometry.poses,
        np.concatenate([odometry.edges, odometry.edges]),
        np.array([[1.0, 0.0, 0.0], [1.2, 0.1, 0.0]]),
        np.array([np.diag([1e2, 1e2, 1e4]), np.diag([0.0, 1e6, 1e6])]),
    )
    np.testing.assert_allclose(optimise(match).poses[1], [1.0, 0.1, 0.0], atol=1e-4)


@pytest.mark.parametrize(
    ("information", "message"),
    [
        (np.diag([1.0, 1.0, -1.0]), "edge 2-3 is not positive semi-definite"),
        (
            np.array([[1.0, 2.0, 0.0], [2.0, 1.0, 0.0], [0.0, 0.0, 1.0]]),
            "edge 2-3 is not positive semi-definite",
        ),
        (np.diag([1.0, 1.0, np.nan]), "information of edge 2-3 is not finite"),
        (np.diag([1.0, np.inf, 1.0]), "information of edge 2-3 is not finite"),
    ],
)
@pytest.mark.parametrize("loss", ["gnc", "none"])
def test_what_gtsam_would_swallow_is_refused(information: Array, message: str, loss: str) -> None:
    _, odometry = noisy_square()
    bad = odometry.information.copy()
    bad[2] = information
    with pytest.raises(ValueError, match=message):
        optimise(replace(odometry, information=bad), loss)  # type: ignore[arg-type]


def test_a_loop_of_wrong_information_is_refused_too() -> None:
    _, odometry = noisy_square()
    with pytest.raises(ValueError, match="edge 0-28 is not positive semi-definite"):
        optimise(odometry.with_loops(np.array([[0, 28]]), np.zeros((1, 3)), -np.eye(3)[None]))


@pytest.mark.parametrize(
    ("covariance", "message"),
    [
        (np.diag([1.0, -1.0, 1.0]), "the covariance of edge 4-7 is not positive definite"),
        (np.diag([1.0, 0.0, 1.0]), "the covariance of edge 4-7 is not positive definite"),
        (np.ones((3, 3)), "the covariance of edge 4-7 is not positive definite"),
        (np.diag([1.0, np.nan, 1.0]), "the covariance of edge 4-7 is not finite"),
    ],
)
def test_a_covariance_that_is_none_is_refused_by_name(covariance: Array, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        informations(np.array([[0, 3], [4, 7]]), np.array([np.eye(3), covariance]))


def test_informations_by_hand() -> None:
    covariance = np.array([[0.5, 0.0, 0.0], [0.0, 2.0, 1.0], [0.0, 1.0, 1.0]])
    expected = [[2.0, 0.0, 0.0], [0.0, 1.0, -1.0], [0.0, -1.0, 2.0]]
    np.testing.assert_allclose(informations(np.array([[0, 1]]), covariance[None]), [expected])
    assert informations(np.zeros((0, 2)), np.zeros((0, 3, 3))).shape == (0, 3, 3)


def test_world_steps_recover_the_path_of_an_ins_whose_yaw_drifts(rms: Rms) -> None:
    truth = square()
    k = np.arange(len(truth) - 1)
    drift = np.radians(0.5) * np.arange(len(truth))
    ins = np.column_stack([truth[:, :2], se2.wrap(truth[:, 2] + drift)])
    # Matching knows how far the robot turned; where it went only the INS can tell.
    turned = se2.between(truth[:-1], truth[1:])[:, 2]
    in_the_body = np.column_stack([se2.between(ins[:-1], ins[1:])[:, :2], turned])
    bent = chain(in_the_body, np.diag([1e4, 1e4, 1e8]), truth[0])
    assert rms(optimise(bent).poses, truth) > 0.5
    world = replace(
        bent,
        information=np.tile(np.diag([0.0, 0.0, 1e8]), (len(k), 1, 1)),
        world_steps=WorldSteps(np.stack([k, k + 1], -1), np.diff(ins[:, :2], axis=0), np.full(len(k), 1e-4)),
    )
    found = optimise(world).poses
    assert rms(found, truth) < 1e-3
    np.testing.assert_allclose(se2.wrap(found[:, 2] - truth[:, 2]), 0.0, atol=1e-3)


def test_world_steps_and_loops_with_gnc(rms: Rms) -> None:
    truth, odometry = noisy_square()
    k = np.arange(len(truth) - 1)
    rng = np.random.default_rng(3)
    moved = np.diff(truth[:, :2], axis=0) + rng.normal(0.0, 0.02, (len(k), 2))
    world = WorldSteps(np.stack([k, k + 1], -1), moved, np.full(len(k), 0.02**2))
    graph = replace(with_loops(odometry, truth, GOOD, FALSE), world_steps=world)
    solution = optimise(graph)
    np.testing.assert_allclose(solution.weights, [1, 1, 1, 0, 0, 0], atol=1e-3)
    assert rms(solution.poses, truth) < 0.15


def test_with_loops_appends_and_marks() -> None:
    truth, odometry = noisy_square()
    graph = with_loops(with_loops(odometry, truth, GOOD[:1], []), truth, GOOD[1:], [])
    assert graph.edges.shape == (59 + 3, 2)
    np.testing.assert_array_equal(np.flatnonzero(graph.loop), [59, 60, 61])
    np.testing.assert_array_equal(graph.edges[-3:], GOOD)
    unchanged = odometry.with_loops(np.zeros((0, 2), dtype=np.int64), np.zeros((0, 3)), np.zeros((0, 3, 3)))
    assert len(unchanged.edges) == len(odometry.edges)


def test_with_only_some_loops() -> None:
    truth, odometry = noisy_square()
    graph = with_loops(odometry, truth, GOOD, FALSE)
    some = graph.with_only(np.array([True, False, False, False, True, False]))
    np.testing.assert_array_equal(some.edges[some.loop], [GOOD[0], FALSE[1]])
    np.testing.assert_array_equal(some.edges[~some.loop], odometry.edges)
    np.testing.assert_array_equal(some.T_ij[some.loop], graph.T_ij[graph.loop][[0, 4]])


def test_marginals_of_a_straight_chain_by_hand() -> None:
    """Two steps ahead of 0.1 m each; the first pose is pinned to 1 mm."""
    graph = chain(np.tile([1.0, 0.0, 0.0], (2, 1)), np.diag([1e2, 1e4, 1e12]), np.zeros(3))
    along = marginals(graph, optimise(graph))[:, 0, 0] - 1e-6
    np.testing.assert_allclose(along, [0.0, 0.01, 0.02], atol=1e-8)


def test_chi_squared_by_hand() -> None:
    graph = chain(np.array([[1.0, 0.0, 0.0]]), np.diag([100.0, 25.0, 4.0]), np.zeros(3))
    off = np.array([[0.0, 0.0, 0.0], [1.1, -0.2, 0.0]])
    np.testing.assert_allclose(chi_squared(graph, off), [100 * 0.1**2 + 25 * 0.2**2])
    np.testing.assert_allclose(chi_squared(graph, graph.poses), [0.0], atol=1e-20)
    turned = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.5]])
    np.testing.assert_allclose(chi_squared(graph, turned), [4 * 0.5**2])


def test_marginals_are_those_of_the_chain() -> None:
    truth, odometry = noisy_square()
    chained = marginals(odometry, optimise(odometry))
    expected = np.diag([1e-6, 1e-6, 1e-8])
    for step, P in zip(odometry.T_ij[:20], chained[:20], strict=True):
        np.testing.assert_allclose(P, expected, rtol=1e-3, atol=1e-9)
        expected = se2.compose_covariance(expected, step, np.diag(SIGMAS**2))
    # A good loop tells where node 28 is; rejected ones tell nothing.
    doubted, trusted = with_loops(odometry, truth, GOOD, FALSE), with_loops(odometry, truth, GOOD, [])
    closed, honest = (marginals(graph, optimise(graph)) for graph in (doubted, trusted))
    assert np.trace(closed[28]) < 0.1 * np.trace(chained[28])
    np.testing.assert_allclose(closed, honest, rtol=0.05, atol=1e-6)


def test_marginals_are_honest() -> None:
    nees = []
    for seed in range(60):
        truth, odometry = noisy_square(seed)
        solution = optimise(odometry)
        e = se2.log(se2.between(solution.poses[20], truth[20]))
        nees.append(e @ np.linalg.solve(marginals(odometry, solution)[20], e))
    low, high = chi2.ppf([0.025, 0.975], 3 * len(nees))
    assert low <= np.sum(nees) <= high
