"""Our own least squares and graduated non-convexity against gtsam's, and what they may ask of a graph."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pytest

from slam import se2
from slam.graph.gauss_newton import (
    Problem,
    chi_squared,
    marginals,
    relative_covariance,
    solve_gnc,
    truncated_weights,
)
from slam.graph.pose_graph import (
    CAUCHY,
    GncConfig,
    PoseGraph,
    WorldSteps,
    optimise,
    to_gtsam,
)
from slam.se2 import Array

SIGMAS = np.array([0.03, 0.02, 0.02])
LIMIT = GncConfig().limit


def ring(n: int = 24, seed: int = 0, ins: bool = False) -> tuple[Array, PoseGraph]:
    """True poses of two rounds on a circle, and a graph of noisy steps, some of them a turned INS's."""
    rng = np.random.default_rng(seed)
    angle = np.linspace(0.0, 4.0 * np.pi, n)
    truth = np.column_stack([3.0 * np.sin(angle), 3.0 - 3.0 * np.cos(angle), se2.wrap(angle)])
    steps = se2.compose(se2.between(truth[:-1], truth[1:]), se2.exp(rng.normal(size=(n - 1, 3)) * SIGMAS))
    poses = [truth[0]]
    for step in steps:
        poses.append(se2.compose(poses[-1], step))
    edges = np.stack([np.arange(n - 1), np.arange(1, n)], -1)
    information = np.tile(np.diag(SIGMAS**-2.0), (n - 1, 1, 1))
    world = WorldSteps()
    if ins:
        moved = np.diff(truth[:, :2], axis=0) + rng.normal(0.0, 0.03, (n - 1, 2))
        world = WorldSteps(edges, moved, np.full(n - 1, 0.03**2))
    return truth, PoseGraph(np.array(poses), edges, steps, information, world_steps=world)


def looped(truth: Array, graph: PoseGraph, false: int = 0) -> PoseGraph:
    """With four true loops between the rounds, and ``false`` ones that are off by metres."""
    half = len(truth) // 2
    pairs = np.array([(k, k + half) for k in (1, 4, 7, 10)] + [(2, 9), (0, 15), (5, 20)][:false])
    T = se2.between(truth[pairs[:, 0]], truth[pairs[:, 1]])
    T[4:, :2] += [2.5, -1.5]
    return graph.with_loops(pairs, T, np.tile(np.diag([1e3, 1e3, 1e4]), (len(pairs), 1, 1)))


def gtsam_information(graph: PoseGraph) -> Array:
    """gtsam's normal matrix ``(3K, 3K)`` at the graph's poses."""
    factors, values = to_gtsam(graph)
    information: Array = factors.linearize(values).hessian()[0]
    return information


def gradient(graph: PoseGraph, poses: Array, step: float = 1e-6) -> Array:
    """Of the cost by every tangent, from differences: the slow obvious twin of the kernel."""
    problem, weights = Problem.of(graph), np.ones(len(graph.edges))
    differences = np.zeros(poses.shape)
    for k, axis in np.ndindex(poses.shape):
        for sign in (1.0, -1.0):
            moved = poses.copy()
            moved[k] = se2.compose(poses[k], se2.exp(sign * step * np.eye(3)[axis]))
            differences[k, axis] += sign * problem.cost(moved, weights) / (2.0 * step)
    return differences


@pytest.mark.parametrize("ins", [False, True])
@pytest.mark.parametrize("heavy", [False, True])
def test_the_gradient_is_that_of_the_cost(ins: bool, heavy: bool) -> None:
    truth, graph = ring(ins=ins)
    graph = replace(
        looped(truth, graph, 3), heavy_tailed=np.arange(len(graph.edges) + 7) % 2 == (0 if heavy else 2)
    )
    _, found = Problem.of(graph).factor(graph.poses, np.ones(len(graph.edges)))
    expected = gradient(graph, graph.poses)
    np.testing.assert_allclose(found, expected, atol=1e-6 * np.abs(expected).max())


@pytest.mark.parametrize("ins", [False, True])
@pytest.mark.parametrize("heavy", [False, True])
def test_it_ends_where_gtsam_does(ins: bool, heavy: bool) -> None:
    truth, graph = ring(ins=ins)
    graph = replace(looped(truth, graph), heavy_tailed=np.arange(len(graph.edges) + 4) < (9 if heavy else 0))
    theirs = optimise(graph, "none")
    ours = Problem.of(graph).descend(graph.poses, np.ones(len(graph.edges)))
    np.testing.assert_allclose(se2.log(se2.between(theirs.poses, ours)), 0.0, atol=2e-3)


def test_the_normal_matrix_is_that_of_gtsam() -> None:
    _, graph = ring(12, ins=True)
    graph = replace(graph, poses=optimise(graph, "none").poses)
    factor, _ = Problem.of(graph).factor(graph.poses, np.ones(len(graph.edges)))
    joint = np.linalg.inv(gtsam_information(graph)).reshape(12, 3, 12, 3)
    np.testing.assert_allclose(factor.inverse_blocks(), joint[range(12), :, range(12)], rtol=1e-4, atol=1e-9)


def test_a_step_of_heavy_tails_gives_way() -> None:
    """A fall turned the INS by 0.3 rad; matches know better. Its weight is that of the Cauchy kernel."""
    edges = np.array([[0, 1], [0, 1]])
    turned = np.array([[1.0, 0.0, 0.0], [1.0, 0.0, 0.3]])
    graph = PoseGraph(np.zeros((2, 3)), edges, turned, np.tile(np.diag([1e4, 1e4, 1e4]), (2, 1, 1)))
    normal = optimise(graph, "none").poses[1, 2]
    robust = Problem.of(replace(graph, heavy_tailed=np.array([False, True]))).descend(
        graph.poses, np.ones(2)
    )[1, 2]
    assert normal == pytest.approx(0.15, abs=1e-3)
    assert robust < 0.01
    weight = 1.0 / (1.0 + (100.0 * (0.3 - robust) / CAUCHY) ** 2)
    assert robust == pytest.approx(weight * (0.3 - robust), rel=0.05)


def test_marks_that_fit_no_edges_are_refused() -> None:
    _, graph = ring(5)
    with pytest.raises(ValueError, match="heavy_tailed marks 2 edges, there are 4"):
        replace(graph, heavy_tailed=np.array([True, False]))


def test_a_pose_that_nothing_ties_is_refused() -> None:
    _, graph = ring(5)
    loose = replace(graph, information=np.zeros((4, 3, 3)))
    with pytest.raises(ValueError, match="its edges leave a pose undetermined"):
        Problem.of(loose).descend(graph.poses, np.ones(4))


# Graduated non-convexity


@pytest.mark.parametrize("ins", [False, True])
@pytest.mark.parametrize("false", [0, 1, 3])
def test_loops_are_judged_as_gtsam_judges_them(ins: bool, false: int) -> None:
    truth, graph = ring(ins=ins)
    graph = looped(truth, graph, false)
    theirs, ours = optimise(graph), solve_gnc(graph)
    np.testing.assert_array_equal(ours.weights, [1] * 4 + [0] * false)
    np.testing.assert_allclose(theirs.weights, ours.weights, atol=1e-3)
    np.testing.assert_allclose(se2.log(se2.between(theirs.poses, ours.poses)), 0.0, atol=5e-3)


def test_what_is_known_is_kept_only_while_nothing_speaks_against_it() -> None:
    truth, graph = ring()
    graph = looped(truth, graph, 3)
    right, wrong = np.array([1.0] * 4 + [0.0] * 3), np.array([0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 1.0])
    for known in (right, wrong, np.ones(7)):
        np.testing.assert_array_equal(solve_gnc(graph, known).weights, right)


def test_weights_by_hand() -> None:
    """At μ = 1 a loop counts fully up to half the limit and not at all from twice it; in between
    √(limit μ (μ + 1) / χ²) − μ."""
    squared = np.array([0.0, 0.5 * LIMIT, LIMIT, 2.0 * LIMIT, 9.0 * LIMIT])
    np.testing.assert_allclose(
        truncated_weights(squared, 1.0, LIMIT), [1.0, 1.0, np.sqrt(2.0) - 1.0, 0.0, 0.0]
    )


def test_the_answer_is_a_minimum_of_truncated_squares() -> None:
    truth, graph = ring()
    graph = looped(truth, graph, 3)
    solution = solve_gnc(graph)
    fits = chi_squared(graph, solution.poses)[graph.loop] <= LIMIT
    np.testing.assert_array_equal(fits, solution.weights == 1.0)


CHANGED = {"inlier_probability": 0.5, "first_mu": 1e-3, "growth": 1.05, "rounds": 2}


@pytest.mark.parametrize("name", [field.name for field in fields(GncConfig)])
def test_every_setting_of_gnc_changes_the_answer(name: str) -> None:
    """With loops that are all somewhat wrong it depends on the limit and the way there which are kept."""
    truth, chain = ring(n=60, seed=3)
    rng = np.random.default_rng(3)
    pairs = np.array([(k, k + 30) for k in range(24)])
    off = rng.uniform(-0.5, 0.5, (24, 3)) * [1.0, 1.0, 0.2]
    T_ij = se2.compose(se2.between(truth[pairs[:, 0]], truth[pairs[:, 1]]), off)
    graph = chain.with_loops(pairs, T_ij, np.tile(np.diag([2e2, 2e2, 1e3]), (24, 1, 1)))
    config = GncConfig(**{name: CHANGED[name]})  # type: ignore[arg-type]
    moved = np.abs(solve_gnc(graph, config=config).poses - solve_gnc(graph).poses).max()
    assert moved > 0.05


# Marginals


def test_marginals_are_those_of_gtsam() -> None:
    import gtsam

    truth, graph = ring(ins=True)
    graph = looped(truth, graph)
    solution = optimise(graph)
    graph = replace(graph, poses=solution.poses)
    theirs = gtsam.Marginals(*to_gtsam(graph))
    expected = [theirs.marginalCovariance(k) for k in range(len(truth))]
    np.testing.assert_allclose(marginals(graph, solution), expected, rtol=1e-3, atol=1e-9)


def test_relative_covariance_along_a_chain() -> None:
    """Seen from a later pose, what was uncertain before it does not matter."""
    _, graph = ring(8)
    factor, _ = Problem.of(graph).factor(graph.poses, np.ones(len(graph.edges)))
    marginal = factor.inverse_blocks()
    found = relative_covariance(factor, marginal, graph.poses, np.array([0, 5, 6, 7]), 7)
    np.testing.assert_allclose(found[2], np.diag(SIGMAS**2.0), rtol=1e-6, atol=1e-12)
    two = se2.compose_covariance(np.diag(SIGMAS**2.0), graph.T_ij[6], np.diag(SIGMAS**2.0))
    np.testing.assert_allclose(found[1], two, rtol=1e-6, atol=1e-12)
    np.testing.assert_allclose(found[3], 0.0, atol=1e-12)
    assert np.trace(found[0]) > np.trace(found[1])


@pytest.mark.parametrize("ins", [False, True])
def test_fixed_poses_stay_and_the_others_end_where_all_would(ins: bool) -> None:
    truth, chain = ring(ins=ins)
    graph = looped(truth, chain)
    weights = np.ones(len(graph.edges))
    best = Problem.of(graph).descend(graph.poses, weights)
    fixed = np.isin(np.arange(len(best)), [0, 5, 6, 13, 20])
    start = np.where(fixed[:, None], best, best + np.array([0.1, -0.05, 0.05]))
    found = Problem.of(graph, fixed).descend(start, weights)
    np.testing.assert_array_equal(found[fixed], best[fixed])
    np.testing.assert_allclose(found, best, atol=1e-4)


def test_covariances_given_the_fixed_poses_are_those_of_the_others_alone() -> None:
    truth, chain = ring()
    graph = looped(truth, chain)
    fixed = np.isin(np.arange(len(truth)), [0, 5, 6, 13, 20])
    factor, _ = Problem.of(graph, fixed).factor(graph.poses, np.ones(len(graph.edges)))
    information = gtsam_information(graph).reshape(len(truth), 3, len(truth), 3)
    free = np.flatnonzero(~fixed)
    alone = information[free][:, :, free].reshape(3 * len(free), 3 * len(free))
    expected = np.linalg.inv(alone).reshape(len(free), 3, len(free), 3)
    blocks = expected[np.arange(len(free)), :, np.arange(len(free))]
    np.testing.assert_allclose(factor.inverse_blocks()[free], blocks, rtol=1e-3, atol=1e-9)
    assert all(np.trace(block) > 0.0 for block in blocks)


@pytest.mark.parametrize("seed", [0, 3])
def test_no_start_hides_the_truth(seed: int) -> None:
    """As many false loops as true ones, turned by any angle, in a graph whose INS may lose its yaw: begun
    where least squares bend it to please them all, both end with true loops out or a false one in."""
    truth, graph = ring(n=60, seed=seed, ins=True)
    rng = np.random.default_rng(seed)
    pairs = np.array(
        [(k, k + 30) for k in range(1, 25, 2)] + [sorted(rng.choice(60, 2, False)) for _ in range(12)]
    )
    T = se2.between(truth[pairs[:, 0]], truth[pairs[:, 1]])
    T[12:] = se2.compose(T[12:], rng.uniform([1.0, 1.0, -np.pi], [4.0, 4.0, np.pi], (12, 3)))
    graph = replace(
        graph, information=graph.information * [0.0, 0.0, 1.0], heavy_tailed=np.ones(59, dtype=bool)
    )
    graph = graph.with_loops(pairs, T, np.tile(np.diag([2e3, 2e3, 1e4]), (24, 1, 1)))
    np.testing.assert_array_equal(solve_gnc(graph).weights, [1.0] * 12 + [0.0] * 12)
