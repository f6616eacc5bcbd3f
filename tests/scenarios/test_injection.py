"""False stitches among true ones: how many, how false, and what a back end makes of them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from scenarios.ablate.injection import inject_false_stitches
from slam import se2
from slam.graph.pose_graph import Loss, PoseGraph
from stitch.align import NoStitch, Stitch
from stitch.mapping.estimate import LoopCandidate
from stitch.mapping.loop_closure import LoopClosureResult
from stitch.mapping.submap_graph import BACK_ENDS, LoopConfig, add_stitches, optimise_robustly


def looped() -> tuple[PoseGraph, LoopClosureResult]:
    """Ten nodes in a line whose steps are a little off, two true stitches, a refused pair, and the answer."""
    truth = np.column_stack([np.arange(10.0), np.zeros(10), np.zeros(10)])
    k = np.arange(9)
    step = np.tile([1.02, 0.0, 0.004], (9, 1))
    poses = [truth[0]]
    for one in step:
        poses.append(se2.compose(poses[-1], one))
    information = np.tile(np.diag(np.array([0.05, 0.05, 0.01]) ** -2), (9, 1, 1))
    line = PoseGraph(np.array(poses), np.stack([k, k + 1], -1), step, information)
    pairs = [(0, 5), (3, 9)]
    stitches = [
        Stitch(se2.between(truth[a], truth[b]), np.diag([0.02, 0.02, 0.005]) ** 2, 1.0, 9.0, 1.0)
        for a, b in pairs
    ]
    graph = add_stitches(line, list(zip(pairs, stitches, strict=True)))
    solution = optimise_robustly(graph, LoopConfig())
    tried = [LoopCandidate(a, b, s, 1.0) for (a, b), s in zip(pairs, stitches, strict=True)]
    return line, LoopClosureResult(
        graph, solution.poses, (tried[0], LoopCandidate(1, 7, NoStitch("no")), tried[1])
    )


@pytest.mark.parametrize("back_end", BACK_ENDS)
def test_false_stitches_harm_plain_least_squares_only(back_end: Loss) -> None:
    line, closed = looped()
    loops = LoopConfig(back_end=back_end)
    before = optimise_robustly(closed.graph, loops).poses
    after = inject_false_stitches(closed, line.poses, 0.5, loops, np.random.default_rng(3))
    moved = np.abs(after.poses[:, :2] - before[:, :2]).max()
    weights = [tried.weight for tried in after.tried]
    assert weights[1] is None
    assert len(weights) == 5
    if back_end == "none":
        assert moved > 0.3
        assert weights == [1.0, None, 1.0, 1.0, 1.0]
    else:
        assert moved < 0.02
        assert [w is not None and w > 0.5 for w in weights] == [True, False, True, False, False]


def test_injected_stitches_are_a_share_are_wrong_and_claim_what_true_ones_do() -> None:
    line, closed = looped()
    after = inject_false_stitches(closed, line.poses, 0.8, LoopConfig(), np.random.default_rng(0))
    again = inject_false_stitches(closed, line.poses, 0.8, LoopConfig(), np.random.default_rng(0))
    np.testing.assert_array_equal(after.poses, again.poses)
    false = after.tried[3:]
    assert len(false) == 8  # of ten
    for tried in false:
        assert isinstance(tried.result, Stitch)
        error = se2.between(se2.between(closed.poses[tried.a], closed.poses[tried.b]), tried.result.T_a_b)
        assert 1.0 <= np.hypot(error[0], error[1]) <= 5.0
        np.testing.assert_array_equal(tried.result.covariance, closed.tried[0].result.covariance)  # type: ignore[union-attr]


def test_nothing_is_injected_where_nothing_was_stitched() -> None:
    line, _ = looped()
    closed = LoopClosureResult(line, line.poses, (LoopCandidate(1, 7, NoStitch("no")),))
    assert inject_false_stitches(closed, line.poses, 0.5, LoopConfig(), np.random.default_rng(0)) is closed


def test_a_stitch_without_a_proper_covariance_is_refused_by_name() -> None:
    line, closed = looped()
    stitch = replace(closed.tried[0].result, covariance=np.diag([1.0, -1.0, 1.0]))  # type: ignore[type-var]
    with pytest.raises(ValueError, match="covariance of edge 2-6 is not positive definite"):
        add_stitches(line, [((2, 6), stitch)])  # type: ignore[list-item]


def test_what_means_nothing_is_refused() -> None:
    line, closed = looped()
    with pytest.raises(ValueError, match="share of false stitches: expected"):
        inject_false_stitches(closed, line.poses, 1.0, LoopConfig(), np.random.default_rng(0))
    with pytest.raises(ValueError, match="back_end: expected one of gnc"):
        LoopConfig(back_end="gcn")  # type: ignore[arg-type]
