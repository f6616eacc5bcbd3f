"""Pairwise consistency: the largest clique, what two loops say of each other, and which are kept."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from slam import se2
from slam.graph.consistency import THRESHOLD, consistent_loops, disagreement, largest_clique
from slam.graph.pose_graph import PoseGraph
from slam.se2 import Array

STEP = np.array([0.10, 0.05, 0.01])
LOOP = np.array([0.02, 0.02, 0.005])


def drive(poses: Array, sigmas: Array = STEP) -> PoseGraph:
    """A graph of steps of ``sigmas`` between poses ``(K, 3)``."""
    k = np.arange(len(poses) - 1)
    steps = se2.between(poses[:-1], poses[1:])
    information = np.tile(np.diag(sigmas**-2), (len(k), 1, 1))
    return PoseGraph(poses, np.stack([k, k + 1], -1), steps, information)


def closed(graph: PoseGraph, pairs: list[tuple[int, int]], offsets: Array) -> PoseGraph:
    """The graph with loops that are off by tangents ``offsets (L, 3)`` from where it has its poses."""
    i, j = np.array(pairs).T
    T = se2.compose(se2.between(graph.poses[i], graph.poses[j]), se2.exp(offsets))
    return graph.with_loops(np.array(pairs), T, np.tile(np.diag(LOOP**-2), (len(pairs), 1, 1)))


def bends(n: int = 20) -> Array:
    """Poses ``(n, 3)`` along a path with bends."""
    rng = np.random.default_rng(2)
    poses = [np.array([1.0, -2.0, 0.3])]
    for _ in range(n - 1):
        poses.append(se2.compose(poses[-1], [1.0, 0.0, rng.normal(0.0, 0.4)]))
    return np.array(poses)


def cliques(adjacent: np.ndarray) -> int:
    """Size of a largest clique, by trying all sets."""
    n = len(adjacent)
    for size in range(n, 0, -1):
        for members in combinations(range(n), size):
            if all(adjacent[a, b] for a, b in combinations(members, 2)):
                return size
    return 0


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 9), st.floats(0.0, 1.0), st.integers(0, 10_000))
def test_no_clique_is_larger(n: int, density: float, seed: int) -> None:
    upper = np.triu(np.random.default_rng(seed).random((n, n)) < density, 1)
    adjacent = upper | upper.T
    found = largest_clique(adjacent)
    assert len(found) == cliques(adjacent)
    assert all(adjacent[a, b] for a, b in combinations(found, 2))
    assert found == sorted(set(found))


def test_a_clique_planted_among_many_is_found() -> None:
    rng = np.random.default_rng(0)
    upper = np.triu(rng.random((120, 120)) < 0.3, 1)
    adjacent = upper | upper.T
    planted = rng.choice(120, 40, replace=False)
    adjacent[np.ix_(planted, planted)] = True
    assert largest_clique(adjacent) == sorted(planted.tolist())


def test_a_search_that_is_cut_short_still_answers_with_a_clique() -> None:
    upper = np.triu(np.random.default_rng(1).random((60, 60)) < 0.5, 1)
    adjacent = upper | upper.T
    found = largest_clique(adjacent, most_steps=20)
    assert len(found) > 1
    assert all(adjacent[a, b] for a, b in combinations(found, 2))


def test_two_loops_of_one_pair_differ_by_their_own_covariances() -> None:
    """No drive lies between them: 0.1 m apart, each sure to 2 cm, is 0.1² / (2 · 0.02²)."""
    graph = closed(drive(bends()), [(2, 9), (2, 9)], np.array([[0.0, 0, 0], [0.1, 0, 0]]))
    assert disagreement(graph)[0, 1] == pytest.approx(0.1**2 / (2 * 0.02**2), rel=1e-3)


def test_the_drive_between_two_loops_by_hand() -> None:
    """Straight ahead without turning: along the track the cycle has two steps' variance and two loops'."""
    along = np.array([0.10, 0.05, 1e-6])
    straight = np.column_stack([np.arange(8.0), np.zeros(8), np.zeros(8)])
    graph = closed(drive(straight, along), [(0, 6), (1, 7)], np.array([[0.0, 0, 0], [0.3, 0, 0]]))
    found = disagreement(graph)
    assert found[0, 1] == pytest.approx(0.3**2 / (2 * 0.10**2 + 2 * 0.02**2), rel=1e-3)
    assert found[1, 0] == found[0, 1]
    assert found[0, 0] == 0.0


def test_a_step_that_a_cycle_drives_twice_errs_twice_alike() -> None:
    """From 2 to 3, and the same way again: (2 σ)², where two independent steps would have 2 σ²."""
    straight = np.column_stack([np.arange(8.0), np.zeros(8), np.zeros(8)])
    pairs = [(2, 3), (3, 2)]
    graph = closed(drive(straight, np.array([0.1, 0.05, 1e-6])), pairs, np.array([[0.0, 0, 0], [0.1, 0, 0]]))
    sigma = (2 * 0.10) ** 2 + 2 * 0.02**2
    assert disagreement(graph)[0, 1] == pytest.approx(0.1**2 / sigma, rel=1e-3)


def test_honest_loops_disagree_as_chance_has_it() -> None:
    """Over many drives whose steps and loops err as they say the distance is 3 on average (χ²₃)."""
    rng = np.random.default_rng(5)
    truth, pairs = bends(), [(1, 12), (4, 17)]
    found = []
    for _ in range(150):
        poses = [truth[0]]
        for step in se2.between(truth[:-1], truth[1:]):
            poses.append(se2.compose(poses[-1], se2.compose(step, se2.exp(0.3 * STEP * rng.normal(size=3)))))
        i, j = np.array(pairs).T
        T = se2.compose(se2.between(truth[i], truth[j]), se2.exp(LOOP * rng.normal(size=(2, 3))))
        graph = drive(np.array(poses), 0.3 * STEP).with_loops(
            np.array(pairs), T, np.tile(np.diag(LOOP**-2), (2, 1, 1))
        )
        found.append(disagreement(graph)[0, 1])
    assert np.mean(found) == pytest.approx(3.0, abs=0.6)  # its standard error is √(6/150) = 0.2
    assert np.mean(np.array(found) > THRESHOLD) < 0.05


def test_the_largest_set_that_agrees_is_kept() -> None:
    """Four true loops against two that agree with nobody, and two that agree with each other."""
    pairs = [(0, 12), (2, 14), (4, 16), (6, 19), (1, 9), (3, 18), (5, 15), (5, 15)]
    offsets = np.zeros((8, 3))
    offsets[4], offsets[5], offsets[6:] = [4.0, 1.0, 1.0], [-3.0, 2.0, -2.0], [0.0, 5.0, 2.0]
    kept = consistent_loops(closed(drive(bends()), pairs, offsets))
    np.testing.assert_array_equal(kept, [True] * 4 + [False] * 4)


def test_a_single_loop_and_none_are_kept() -> None:
    graph = drive(bends())
    assert consistent_loops(closed(graph, [(0, 9)], np.array([[9.0, 0, 0]]))).tolist() == [True]
    assert consistent_loops(graph).tolist() == []
