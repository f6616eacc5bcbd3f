"""Closing loops: whom a submap is stitched to, with what prior, when again, and what is told of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from scenarios.run_folder.write import stitch_to_json
from slam import se2
from slam.graph.pose_graph import PoseGraph
from slam.mapping.occupancy import Grid
from slam.mapping.submap import Submap
from slam.recording import Laser
from slam.scan import Scan
from slam.se2 import Array
from stitch.align import NoStitch, Prior, Stitch
from stitch.mapping.estimate import Estimate
from stitch.mapping.loop_closure import LoopCloser, close_loops
from stitch.mapping.submap_graph import LoopConfig, SubmapGraph

N = 12
SIGMA = np.array([0.05, 0.05, 0.03])


def truth(rounds: int = 2) -> Array:
    """Anchors of N / 2 submaps a round, on a ring of 6 m."""
    angle = 4.0 * np.pi * np.arange(rounds * N // 2) / N
    return np.column_stack([3.0 * np.sin(angle), -3.0 * np.cos(angle), se2.wrap(angle)])


def ring(drift: float = 0.02, rounds: int = 2) -> tuple[list[Submap], PoseGraph]:
    """The submaps, ten scans each and nothing in them but their anchor, and their chain, which drifts."""
    true = truth(rounds)
    steps = se2.compose(se2.between(true[:-1], true[1:]), [0.0, 0.0, drift])
    poses = [true[0]]
    for step in steps:
        poses.append(se2.compose(poses[-1], step))
    nothing = Scan.from_ranges(np.full(3, np.nan), np.arange(3.0), Laser())
    grid = Grid(np.zeros((1, 1), dtype=bool), np.zeros((1, 1), dtype=bool), np.zeros(2), 0.1)
    submaps = [Submap(10 * k, 10 * k + 10, poses[k], nothing, grid) for k in range(len(true))]
    k = np.arange(len(true) - 1)
    information = np.tile(np.diag(SIGMA**-2.0), (len(k), 1, 1))
    return submaps, PoseGraph(np.array(poses), np.stack([k, k + 1], -1), steps, information)


class Stitcher:
    """Answers with the truth where ``told`` allows it, and remembers what it was asked."""

    def __init__(self, told: Sequence[tuple[int, int]] | None = None) -> None:
        self.told = told
        self.asked: list[tuple[int, int, Prior | None]] = []

    def __call__(self, a: Submap, b: Submap, prior: Prior | None) -> Stitch | NoStitch:
        pair = a.start // 10, b.start // 10
        self.asked.append((*pair, prior))
        if self.told is not None and pair not in self.told:
            return NoStitch("not told")
        at = truth(2 + max(pair) // (N // 2))
        T = se2.between(at[pair[0]], at[pair[1]])
        return Stitch(T, np.diag([0.01, 0.01, 0.003]) ** 2, 1.0, 9.0, 1.0)


CONFIG = LoopConfig(reach=1.0, candidates=3, spread=2)


def test_the_ring_is_closed_and_every_stitch_kept() -> None:
    submaps, odometry = ring()
    closed = close_loops(SubmapGraph(submaps, odometry, "odometry", CONFIG), Stitcher())
    off = np.linalg.norm(
        se2.between(closed.poses[0], closed.poses)[:, :2] - se2.between(truth()[0], truth())[:, :2], axis=1
    )
    before = np.linalg.norm(odometry.poses[:, :2] - truth()[:, :2], axis=1)
    assert off.max() < 0.5 * before.max()
    assert {(one.a, one.b) for one in closed.tried} >= {(k, k + N // 2) for k in range(N // 2)}
    assert all(one.weight == 1.0 for one in closed.tried)


def test_the_prior_is_what_the_graph_knows_and_a_little_more() -> None:
    """Along a chain the covariances add up; the window is three sigma wide."""
    submaps, odometry = ring()
    graph = SubmapGraph(submaps, odometry, "ins", replace(CONFIG, inflation=2.0))
    least = np.diag([CONFIG.window_ins, CONFIG.window_ins, CONFIG.window_angle]) / 3.0
    np.testing.assert_allclose(graph.prior(4, 5).covariance, 2.0 * np.diag(SIGMA**2) + least**2, atol=1e-12)
    assert np.linalg.det(graph.prior(0, 5).covariance) > np.linalg.det(graph.prior(3, 5).covariance)
    np.testing.assert_allclose(graph.prior(0, 5).T_a_b, se2.between(odometry.poses[0], odometry.poses[5]))
    for source, window in (("odometry", CONFIG.window), ("ins", CONFIG.window_ins)):
        narrow = SubmapGraph(submaps, odometry, source, replace(CONFIG, inflation=0.0)).prior(4, 5)
        assert 3.0 * np.sqrt(narrow.covariance[0, 0]) == pytest.approx(window)


def test_a_stitch_makes_the_graph_know_more() -> None:
    submaps, odometry = ring()
    graph = SubmapGraph(submaps, odometry, "odometry", CONFIG)
    before = graph.relative_covariances(6)[0]
    LoopCloser(graph, Stitcher()).close_loops(6, 0)
    assert np.trace(graph.relative_covariances(6)[0]) < 0.1 * np.trace(before)


def test_a_pair_of_which_too_little_is_known_is_searched_everywhere() -> None:
    submaps, odometry = ring()
    lost = replace(odometry, information=odometry.information * 1e-6)
    stitcher = Stitcher([])
    close_loops(SubmapGraph(submaps, lost, "odometry", CONFIG), stitcher)
    assert stitcher.asked
    assert all(prior is None for *_, prior in stitcher.asked)
    assert max(np.bincount([b for _, b, _ in stitcher.asked])) <= CONFIG.candidates


def test_across_a_failure_neighbours_come_first() -> None:
    submaps, odometry = ring()
    submaps[3] = replace(submaps[3], stop=38)
    stitcher = Stitcher()
    close_loops(SubmapGraph(submaps, odometry, "odometry", CONFIG), stitcher)
    assert next(a for a, b, _ in stitcher.asked if b == 4) == 3
    assert 4 not in [a for a, b, _ in stitcher.asked if b == 5]


def test_a_refused_pair_is_tried_again_when_it_is_expected_elsewhere_but_not_for_ever() -> None:
    submaps, odometry = ring()
    graph = SubmapGraph(submaps, odometry, "odometry", CONFIG)
    closer = LoopCloser(graph, Stitcher([]))
    closer.close_loops(6, 0)
    asked = set(graph.results)
    assert (0, 6) in asked
    closer.redraw(None)
    assert set(graph.results) == asked  # nothing has moved
    for turn in (1, 2):
        graph.poses = graph.poses.copy()
        graph.poses[6, 0] += 0.9 * turn
        closer.redraw(None)
        closer.close_loops(6, turn)
    assert [one.round for one in closer.tried if (one.a, one.b) == (0, 6)] == [0, 1]


def test_a_submap_drawn_anew_reopens_its_pairs() -> None:
    submaps, odometry = ring()
    graph = SubmapGraph(submaps, odometry, "odometry", CONFIG)
    closer = LoopCloser(graph, Stitcher([]))
    closer.close_loops(6, 0)
    closer.close_loops(7, 0)
    tried = set(graph.results)
    closer.redraw(lambda poses, drawn: [replace(s) if k == 7 else s for k, s in enumerate(drawn)])
    assert set(graph.results) == {pair for pair in tried if 7 not in pair}


def test_what_the_graph_knows_is_not_stitched() -> None:
    submaps, odometry = ring()
    graph = SubmapGraph(submaps, odometry, "odometry", CONFIG)
    open_still = graph.expected_information(0, 6)
    LoopCloser(graph, Stitcher([(0, 6)])).close_loops(6, 0)
    assert graph.expected_information(0, 6) < 0.5 * open_still
    stitcher = Stitcher()
    close_loops(
        SubmapGraph(submaps, odometry, "odometry", replace(CONFIG, least_information=100.0)), stitcher
    )
    assert stitcher.asked == []


def test_what_a_round_asks_does_not_grow_with_the_rounds_before() -> None:
    """Every place has been seen ever more often; what ties a submap to one of them ties it to all."""
    rounds, config = 8, replace(CONFIG, candidates=5, spread=1)
    submaps, odometry = ring(rounds=rounds)
    asked = {}
    for least in (0.0, config.least_information):
        stitcher = Stitcher()
        close_loops(
            SubmapGraph(submaps, odometry, "odometry", replace(config, least_information=least)), stitcher
        )
        asked[least] = np.bincount([b // (N // 2) for _, b, _ in stitcher.asked], minlength=rounds)
    assert np.all(asked[0.0][-3:] == config.candidates * N // 2)
    assert np.all(asked[config.least_information][1:] <= 1.5 * N // 2)


def test_nodes_between_submaps_leave_the_answer_as_it_is() -> None:
    """Each step in two halves: node 2 k is submap k."""
    submaps, odometry = ring()
    half = se2.exp(0.5 * se2.log(odometry.T_ij))
    poses = np.zeros((2 * N - 1, 3))
    poses[::2], poses[1::2] = odometry.poses, se2.compose(odometry.poses[:-1], half)
    k = np.arange(2 * N - 2)
    information = np.linalg.inv(0.5 * np.tile(np.diag(SIGMA**2), (len(k), 1, 1)))
    fine = PoseGraph(poses, np.stack([k, k + 1], -1), np.repeat(half, 2, axis=0), information)
    coarse = close_loops(SubmapGraph(submaps, odometry, "odometry", CONFIG), Stitcher())
    split = close_loops(SubmapGraph(submaps, fine, "odometry", CONFIG, 2 * np.arange(N)), Stitcher())
    assert [(one.a, one.b) for one in split.tried] == [(one.a, one.b) for one in coarse.tried]
    np.testing.assert_allclose(split.poses[::2, :2], coarse.poses[:, :2], atol=0.05)


def test_the_story_tells_when_where_and_why() -> None:
    submaps, odometry = ring()
    closed = close_loops(SubmapGraph(submaps, odometry, "odometry", CONFIG), Stitcher([(0, 6)]))
    estimate = Estimate("ours", odometry.poses, submaps=tuple(submaps), stitches=closed.tried)
    told = [stitch_to_json(estimate, one, None) for one in closed.tried]
    by_pair = {(one["a"], one["b"]): one for one in told}
    found = by_pair[0, 6]
    assert (found["turn"], found["scan"], found["accepted"], found["weight"]) == (0, 69, True, 1.0)
    assert np.shape(found["prior"].T_a_b) == (3,)  # type: ignore[attr-defined]
    refused = by_pair[1, 7]
    assert (refused["reason"], refused["weight"], refused["accepted"]) == ("not told", None, False)
