"""A graph that grows: the same answer as all at once, and edges that may be taken away again."""

from __future__ import annotations

import numpy as np
import pytest

from slam import se2
from slam.graph.gauss_newton import marginals
from slam.graph.isam2 import IncrementalGraph
from slam.graph.pose_graph import PoseGraph, Solution, WorldSteps, optimise
from slam.se2 import Array

N, LAP = 60, 30
KNOWN = np.diag([100.0**2, 100.0**2, 100.0**2])
YAW_ONLY = np.diag([0.0, 0.0, 100.0**2])


@pytest.fixture(scope="module")
def drive() -> tuple[Array, Array, Array]:
    """Two laps: true poses, noisy steps, an INS's noisy world-frame displacements."""
    rng = np.random.default_rng(0)
    truth = [np.array([1.0, 2.0, 0.3])]
    for _ in range(N):
        truth.append(se2.compose(truth[-1], np.array([0.2, 0.0, 2.0 * np.pi / LAP])))
    poses = np.array(truth)
    steps = se2.between(poses[:-1], poses[1:]) + rng.normal(0.0, [0.01, 0.01, 0.02], (N, 3))
    world = np.diff(poses[:, :2], axis=0) + rng.normal(0.0, 0.01, (N, 2))
    return poses, steps, world


def grown(truth: Array, steps: Array, world: Array) -> IncrementalGraph:
    graph = IncrementalGraph(truth[0])
    for k, step in enumerate(steps):
        assert graph.add_node(se2.compose(graph.pose(k), step)) == k + 1
        graph.add_edge(k, k + 1, step, YAW_ONLY)
        graph.add_world_step(k, k + 1, world[k], 0.01**2)
        if k + 1 >= LAP:
            graph.add_edge(k + 1 - LAP, k + 1, se2.between(truth[k + 1 - LAP], truth[k + 1]), KNOWN)
        graph.update()
    graph.update(3)
    return graph


def test_step_by_step_is_as_good_as_all_at_once(drive: tuple[Array, Array, Array]) -> None:
    truth, steps, world = drive
    graph = grown(*drive)
    chain = np.array([(k, k + 1) for k in range(N)])
    laps = np.array([(k - LAP, k) for k in range(LAP, N + 1)])
    start = [truth[0]]
    for step in steps:
        start.append(se2.compose(start[-1], step))
    batch = PoseGraph(
        np.array(start),
        np.concatenate([chain, laps]),
        np.concatenate([steps, se2.between(truth[laps[:, 0]], truth[laps[:, 1]])]),
        np.concatenate([np.tile(YAW_ONLY, (N, 1, 1)), np.tile(KNOWN, (len(laps), 1, 1))]),
        world_steps=WorldSteps(chain, world, np.full(N, 0.01**2)),
    )
    solution = optimise(batch, "none")
    apart = np.abs(se2.between(solution.poses, graph.poses()))
    assert len(graph.poses()) == N + 1
    assert apart.max() < 5e-3  # poses are linearised anew from 0.05 on
    expected = marginals(batch, Solution(graph.poses(), solution.weights))
    np.testing.assert_allclose(graph.marginals(), expected, atol=0.1 * expected.max())


def test_a_world_step_does_not_turn_with_the_yaw() -> None:
    """The second node's yaw is known to be a quarter turn off its guess: the INS's step stays where it is."""
    graph = IncrementalGraph(np.zeros(3))
    graph.add_node(np.array([0.0, 1.0, 0.0]))
    graph.add_edge(0, 1, np.array([0.0, 0.0, np.pi / 2]), YAW_ONLY)
    graph.add_world_step(0, 1, np.array([1.0, 0.0]), 1e-4)
    graph.add_node(np.array([1.0, 1.0, 0.0]))
    graph.add_edge(1, 2, np.array([0.0, 0.0, 0.0]), YAW_ONLY)
    graph.add_world_step(1, 2, np.array([1.0, 0.0]), 1e-4)
    graph.update(10)
    np.testing.assert_allclose(graph.poses(), [[0, 0, 0], [1, 0, np.pi / 2], [2, 0, np.pi / 2]], atol=1e-6)


def test_what_waits_is_at_its_guess_and_counts_with_the_next_update() -> None:
    graph = IncrementalGraph(np.zeros(3))
    graph.add_node(np.array([5.0, 0.0, 0.0]))
    graph.add_edge(0, 1, np.array([1.0, 0.0, 0.0]), KNOWN)
    np.testing.assert_array_equal(graph.pose(1), [5.0, 0.0, 0.0])
    np.testing.assert_array_equal(graph.poses(), [[0, 0, 0], [5, 0, 0]])
    graph.update()
    np.testing.assert_allclose(graph.pose(1), [1.0, 0.0, 0.0], atol=1e-9)


def test_an_edge_that_is_removed_counts_no_more() -> None:
    graph = IncrementalGraph(np.zeros(3))
    graph.add_node(np.array([1.0, 0.0, 0.0]))
    graph.add_edge(0, 1, np.array([1.0, 0.0, 0.0]), KNOWN)
    false = graph.add_edge(0, 1, np.array([3.0, 0.0, 0.0]), KNOWN)
    graph.update(3)
    assert graph.pose(1)[0] == pytest.approx(2.0, abs=1e-6)
    graph.remove([false])
    graph.update(3)
    assert graph.pose(1)[0] == pytest.approx(1.0, abs=1e-6)


def test_heavy_tails_lose_against_what_is_sure() -> None:
    for heavy_tailed, expected in ((False, (1.4, 1.6)), (True, (0.99, 1.02))):
        graph = IncrementalGraph(np.zeros(3))
        graph.add_node(np.array([1.0, 0.0, 0.0]))
        graph.add_edge(0, 1, np.array([1.0, 0.0, 0.0]), KNOWN)
        graph.add_edge(0, 1, np.array([2.0, 0.0, 0.0]), KNOWN, heavy_tailed)
        graph.update(20)
        assert expected[0] < graph.pose(1)[0] < expected[1]


def test_the_covariance_between_two_nodes_is_that_of_what_lies_between() -> None:
    graph = IncrementalGraph(np.zeros(3))
    for k, step in enumerate(([3.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 0.0, np.pi / 2])):
        graph.add_node(se2.compose(graph.pose(k), np.array(step)))
        graph.add_edge(k, k + 1, np.array(step), np.diag([100.0, 25.0, 400.0]))
        graph.update()
    each = np.diag([0.01, 0.04, 0.0025])
    turned = se2.transport(each, np.array([0.0, 0.0, -np.pi / 2]))
    np.testing.assert_allclose(graph.relative_covariance(1, 3), turned + each, atol=1e-9)
