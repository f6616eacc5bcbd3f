"""Every method, on a short drive: an answer for every scan, the same twice, and no look at the truth."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from scenarios.methods import FAIR, METHODS, ONLINE, SEES_TRUTH
from scenarios.methods.config import MethodConfig
from scenarios.methods.oracle import failures, with_true_failures
from scenarios.run import Options
from sim.laser import Raycaster
from slam import se2
from slam.cli import InputError
from slam.graph.pose_graph import PoseGraph
from slam.odometry.segmentation import Segment
from slam.odometry.track import Track, Verdict
from slam.recording import Laser, Recording
from slam.se2 import Array
from stitch.align import NoStitch, Stitch
from stitch.mapping.estimate import Estimate, LoopCandidate
from stitch.mapping.loop_closure import BACK_ENDS, Closed, LoopConfig, settled, with_false, with_stitches
from stitch.mapping.offline import between, chop, settled_start, upheld

ANGLES = np.radians(np.linspace(-110.0, 110.0, 111))
LASER = Laser(range_max=8.0)
BLIND = [*range(22, 24)]
N = 56


def walls() -> Array:
    """A room of 6 m x 5 m with two cupboards and a stub of wall."""
    boxes = [(0.0, 0.0, 6.0, 5.0), (2.6, 2.0, 3.4, 3.0), (4.8, 0.0, 6.0, 0.7)]
    sides = [
        side
        for x0, y0, x1, y1 in boxes
        for side in ([x0, y0, x1, y0], [x1, y0, x1, y1], [x1, y1, x0, y1], [x0, y1, x0, y0])
    ]
    return np.array([*sides, [0.0, 3.3, 0.8, 3.3]])


def circle() -> Array:
    """True poses ``(N, 3)`` once round the room and a little further."""
    angle = np.linspace(0.0, 2.3 * np.pi, N)
    x, y = 3.0 + 1.7 * np.sin(angle), 2.5 - 1.4 * np.cos(angle)
    return np.column_stack([x, y, np.arctan2(1.4 * np.sin(angle), 1.7 * np.cos(angle))])


def drive(source: str) -> Recording:
    """A recording with a blind stretch, and dead reckoning that drifts the way its source does."""
    rng = np.random.default_rng(4)
    truth = circle()
    ranges = Raycaster.from_segments(walls()).cast(truth, ANGLES, LASER.range_max)
    ranges = ranges + rng.normal(0.0, 0.01, ranges.shape)
    ranges[BLIND] = np.nan
    if source == "ins":
        walk = np.cumsum(rng.normal(0.0, 0.003, (N, 2)), axis=0)
        yaw = truth[0, 2] + 1.08 * (np.unwrap(truth[:, 2]) - truth[0, 2])
        reckoned = np.column_stack([truth[:, :2] + walk, se2.wrap(yaw)])
    else:
        steps = se2.between(truth[:-1], truth[1:]) * [1.04, 1.0, 1.05]
        steps = steps + rng.normal(0.0, 0.004, steps.shape)
        reckoned = np.array(truth[:1])
        for step in steps:
            reckoned = np.vstack([reckoned, se2.compose(reckoned[-1], step)])
    return Recording("circle", 0.2 * np.arange(N), ranges, ANGLES, LASER, reckoned, source, truth=truth)  # type: ignore[arg-type]


def config() -> MethodConfig:
    """The defaults, with a lighter bundle and shorter submaps."""
    default = MethodConfig()
    return replace(
        default,
        loops=replace(default.loops, length=2.0, candidates=2),
        bundle=replace(default.bundle, neighbours=5, per_pass=3, radii=(0.4, 0.2)),
    )


@pytest.fixture(scope="module")
def estimates() -> dict[tuple[str, str], Estimate]:
    """What every method says of the drive, by method and source."""
    return {
        (name, source): method(drive(source), config())
        for name, method in METHODS.items()
        for source in ("ins", "odometry")
    }


def answers(estimate: Estimate) -> list[Array]:
    """Everything numerical in an estimate."""
    found = [estimate.poses, *(s.anchor for s in estimate.submaps)]
    found += [] if estimate.covariance is None else [estimate.covariance]
    found += [] if estimate.track is None else [estimate.track.poses, *estimate.track.confidence.values()]
    for tried in estimate.stitches:
        found.append(np.array([tried.a, tried.b, tried.accepted, tried.weight is None]))
        if hasattr(tried.result, "T_a_b"):
            found.append(tried.result.T_a_b)
    return found


def assert_same(a: Estimate, b: Estimate) -> None:
    first, second = answers(a), answers(b)
    assert len(first) == len(second)
    for x, y in zip(first, second, strict=True):
        np.testing.assert_array_equal(x, y)


def error(poses: Array, truth: Array) -> float:
    apart = se2.between(poses[0], poses)[:, :2] - se2.between(truth[0], truth)[:, :2]
    return float(np.sqrt(np.mean(np.sum(apart**2, axis=1))))


@pytest.mark.parametrize("name", METHODS)
@pytest.mark.parametrize("source", ["ins", "odometry"])
def test_a_pose_for_every_scan(estimates: dict[tuple[str, str], Estimate], name: str, source: str) -> None:
    estimate = estimates[name, source]
    assert estimate.method == name
    assert estimate.poses.shape == (N, 3)
    assert np.all(np.isfinite(estimate.poses))
    assert np.all(np.abs(estimate.poses[:, 2]) <= np.pi)
    if estimate.covariance is not None:
        assert estimate.covariance.shape == (N, 3, 3)
        assert np.all(np.linalg.eigvalsh(estimate.covariance) > 0.0)
    for submap in estimate.submaps:
        assert 0 <= submap.start < submap.stop <= N
    for tried in estimate.stitches:
        assert 0 <= tried.a < tried.b < len(estimate.submaps)
        assert tried.weight is None or 0.0 <= tried.weight <= 1.0


@pytest.mark.parametrize("name", FAIR)
@pytest.mark.parametrize("source", ["ins", "odometry"])
def test_the_truth_is_not_read(estimates: dict[tuple[str, str], Estimate], name: str, source: str) -> None:
    recording = drive(source)
    assert_same(METHODS[name](replace(recording, truth=None), config()), estimates[name, source])


@pytest.mark.parametrize("name", FAIR)
def test_another_truth_changes_nothing_and_a_second_run_neither(
    estimates: dict[tuple[str, str], Estimate], name: str
) -> None:
    lie = np.random.default_rng(1).normal(0.0, 5.0, (N, 3))
    assert_same(METHODS[name](replace(drive("ins"), truth=lie), config()), estimates[name, "ins"])


@pytest.mark.parametrize("name", FAIR)
@pytest.mark.parametrize("source", ["ins", "odometry"])
@pytest.mark.parametrize("scans", [1, 2, 9])
def test_where_nothing_can_be_matched_there_is_dead_reckoning(name: str, source: str, scans: int) -> None:
    whole = drive(source)
    ranges = whole.ranges[:scans].copy()
    ranges[1:] = np.nan
    short = replace(
        whole, time=whole.time[:scans], ranges=ranges, dead_reckoning=whole.dead_reckoning[:scans], truth=None
    )
    estimate = METHODS[name](short, config())
    np.testing.assert_allclose(se2.log(se2.between(short.dead_reckoning, estimate.poses)), 0.0, atol=1e-9)
    assert estimate.stitches == ()


@pytest.mark.parametrize("source", ["ins", "odometry"])
def test_how_they_compare(estimates: dict[tuple[str, str], Estimate], source: str) -> None:
    recording = drive(source)
    assert recording.truth is not None
    np.testing.assert_array_equal(estimates["ins", source].poses, recording.dead_reckoning)
    errors = {name: error(estimates[name, source].poses, recording.truth) for name in METHODS}
    assert errors["slamstitch"] < 0.02
    assert errors["slamstitch"] < errors["ins"]
    assert errors["slamstitch"] < errors["icp"]


def test_htms_is_cut_where_the_laser_was_blind(estimates: dict[tuple[str, str], Estimate]) -> None:
    pieces = [(s.start, s.stop) for s in estimates["htms", "ins"].submaps]
    # The scan after the blind ones is lost as well: its reference is a blind scan.
    assert pieces[0] == (0, 22)
    assert all(stop <= 22 or start > 23 for start, stop in pieces)
    assert [(t.a, t.b) for t in estimates["htms", "ins"].stitches] == [(0, b) for b in range(1, len(pieces))]


@pytest.mark.parametrize("length", [0.5, 1.0, 3.0, 100.0])
def test_chop_keeps_every_scan_and_limits_the_length(length: float) -> None:
    poses = np.column_stack([0.1 * np.arange(60), np.zeros(60), np.zeros(60)])
    nothing = np.zeros((60, 3, 3))
    verdict = np.full(60, int(Verdict.MATCHED))
    track = Track(poses, verdict, np.arange(-1, 59), nothing, nothing, np.full(60, 9), {})
    stretches = (Segment(0, 25), Segment(27, 60))
    pieces = chop(track, stretches, length)
    covered = np.concatenate([np.arange(p.start, p.stop) for p in pieces])
    np.testing.assert_array_equal(covered, np.setdiff1d(np.arange(60), [25, 26]))
    lengths = [se2.path_length(poses[p.start : p.stop])[-1] for p in pieces]
    assert max(lengths) <= min(1.5 * length, 3.3) + 0.1


def test_chop_at_rest_is_one_piece() -> None:
    nothing = np.zeros((5, 3, 3))
    track = Track(np.zeros((5, 3)), np.zeros(5), np.arange(-1, 4), nothing, nothing, np.zeros(5), {})
    assert chop(track, (Segment(0, 5),), 1.0) == [Segment(0, 5)]


@pytest.mark.parametrize(
    ("jump_at", "degrees", "start"), [(21, 2.5, 21), (23, -1.4, 23), (24, 2.5, 20), (21, 0.6, 20)]
)
def test_a_piece_begins_where_the_track_turns_as_dead_reckoning_does(
    jump_at: int, degrees: float, start: int
) -> None:
    """A jump within three steps of the failure is made good before the piece begins, a later one not."""
    recording = drive("ins")
    nothing = np.zeros((N, 3, 3))
    poses = recording.dead_reckoning.copy()
    poses[jump_at:, 2] += np.radians(degrees)
    track = Track(poses, np.zeros(N), np.arange(-1, N - 1), nothing, nothing, np.full(N, 9), {})
    assert settled_start(recording, track, Segment(20, 40)) == Segment(start, 40)
    alone = replace(recording, source="none", dead_reckoning=np.zeros((N, 3)))
    assert settled_start(alone, track, Segment(20, 40)).start == 20
    assert settled_start(recording, track, Segment(0, 40)).start == 0


@pytest.mark.parametrize(
    ("off", "kept"), [((0.1, -0.1, 0.02), True), ((0.0, 0.25, 0.0), False), ((0.0, 0.0, -0.03), False)]
)
def test_a_stitch_that_the_bundle_refutes_is_switched_off(off: tuple[float, ...], kept: bool) -> None:
    anchors = np.array([[0.0, 0.0, 0.5], [3.0, 1.0, -2.0]])
    T_a_b = se2.compose(se2.between(*anchors), np.array(off))
    tried = (
        LoopCandidate(0, 1, Stitch(T_a_b, np.eye(3), 9.0, 20.0, 1.0, (), 3.0), weight=1.0),
        LoopCandidate(0, 1, NoStitch("overlap")),
    )
    found, refused = upheld(tried, anchors)
    assert found.accepted == kept
    assert refused == tried[1]


def test_the_graph_has_nodes_where_nothing_was_matched() -> None:
    poses = np.column_stack([0.3 * np.arange(60), np.zeros(60), np.zeros(60)])
    nothing = np.zeros((60, 3, 3))
    track = Track(poses, np.zeros(60), np.arange(-1, 59), nothing, nothing, np.full(60, 9), {})
    rows = between(track, [Segment(8, 20), Segment(20, 30), Segment(40, 60)])
    np.testing.assert_array_equal(rows, [0, 4, 7, 8, 29, 33, 36, 39, 40, 59])


@pytest.mark.parametrize("name", SEES_TRUTH)
def test_who_needs_the_truth_says_so_in_one_line(name: str) -> None:
    with pytest.raises(InputError, match=r"^oracle: expected a recording with truth, circle has none$"):
        METHODS[name](replace(drive("ins"), truth=None), config())


def test_nobody_is_told_the_truth_unasked() -> None:
    assert set(METHODS) == {*FAIR, *SEES_TRUTH, ONLINE}
    assert Options().methods.split(",") == list(FAIR)


def test_the_oracles_stitches_are_true_and_all_kept(estimates: dict[tuple[str, str], Estimate]) -> None:
    truth, estimate = circle(), estimates["oracle", "odometry"]
    stitched = [tried for tried in estimate.stitches if isinstance(tried.result, Stitch)]
    assert stitched
    for tried in stitched:
        a, b = estimate.submaps[tried.a].start, estimate.submaps[tried.b].start
        np.testing.assert_allclose(tried.result.T_a_b, se2.between(truth[a], truth[b]), atol=1e-12)  # type: ignore[union-attr]
        assert np.all(np.linalg.eigvalsh(tried.result.covariance) > 0.0)  # type: ignore[union-attr]
        assert tried.weight == 1.0


def straight_track(n: int) -> Track:
    """One metre a scan straight ahead, all matched; the fourth scan says it was lost."""
    poses = np.column_stack([np.arange(float(n)), np.zeros(n), np.zeros(n)])
    nothing = np.zeros((n, 3, 3))
    trace = np.zeros(n)
    trace[3], trace[1] = np.inf, np.nan
    return Track(poses, np.zeros(n), np.arange(-1, n - 1), nothing, nothing, np.zeros(n), {"trace2": trace})


def test_failures_are_steps_off_by_10_cm_or_2_degrees() -> None:
    truth = straight_track(6).poses
    poses = truth.copy()
    poses[2:, 0] += 0.09
    poses[3:, 1] += 0.11
    poses[4:] = se2.compose(poses[4], se2.compose([0, 0, np.radians(1.9)], se2.between(poses[4], poses[4:])))
    poses[5] = se2.compose(poses[5], [0, 0, np.radians(-2.1)])
    np.testing.assert_array_equal(failures(poses, truth), [False, False, False, True, False, True])


def test_the_oracle_is_cut_where_a_step_failed_and_nowhere_else() -> None:
    """It slid by half a metre unnoticed: there it now follows the wheels, and the drive after it is as
    driven."""
    track, n = straight_track(6), 6
    truth = track.poses
    slid = truth.copy()
    slid[4:, 0] += 0.5
    recording = Recording("line", np.arange(6.0), np.ones((n, 3)), np.arange(3.0), LASER, truth, truth=truth)
    told = with_true_failures(recording, replace(track, poses=slid), truth, "trace2")
    np.testing.assert_allclose(told.poses, truth, atol=1e-12)
    np.testing.assert_array_equal(np.flatnonzero(told.verdict == Verdict.FELL_BACK), [4])
    np.testing.assert_array_equal(told.confidence["trace2"], [0, np.nan, 0, 0, np.inf, 0])


def looped() -> tuple[PoseGraph, Closed]:
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
    graph = with_stitches(line, list(zip(pairs, stitches, strict=True)))
    solution = settled(graph, "gnc")
    tried = [LoopCandidate(a, b, s, 1.0) for (a, b), s in zip(pairs, stitches, strict=True)]
    return line, Closed(graph, solution.poses, (tried[0], LoopCandidate(1, 7, NoStitch("no")), tried[1]))


@pytest.mark.parametrize("back_end", BACK_ENDS)
def test_false_stitches_harm_plain_least_squares_only(back_end: str) -> None:
    line, closed = looped()
    before = settled(closed.graph, back_end).poses  # type: ignore[arg-type]
    options = LoopConfig(back_end=back_end, injected=0.5)  # type: ignore[arg-type]
    after = with_false(closed, line.poses, options, np.random.default_rng(3))
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
    options = LoopConfig(injected=0.8)
    after = with_false(closed, line.poses, options, np.random.default_rng(0))
    again = with_false(closed, line.poses, options, np.random.default_rng(0))
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
    closed = Closed(line, line.poses, (LoopCandidate(1, 7, NoStitch("no")),))
    assert with_false(closed, line.poses, LoopConfig(injected=0.5), np.random.default_rng(0)) is closed


def test_a_stitch_without_a_proper_covariance_is_refused_by_name() -> None:
    line, closed = looped()
    stitch = replace(closed.tried[0].result, covariance=np.diag([1.0, -1.0, 1.0]))  # type: ignore[type-var]
    with pytest.raises(ValueError, match="covariance of edge 2-6 is not positive definite"):
        with_stitches(line, [((2, 6), stitch)])  # type: ignore[list-item]


@pytest.mark.parametrize(
    ("settings", "complaint"),
    [
        ({"back_end": "gcn"}, "back_end: expected one of gnc"),
        ({"injected": 1.0}, "injected: expected a share"),
    ],
)
def test_settings_that_mean_nothing_are_refused(settings: dict[str, object], complaint: str) -> None:
    with pytest.raises(ValueError, match=complaint):
        LoopConfig(**settings)  # type: ignore[arg-type]


def test_the_settings_reach_the_graph() -> None:
    """Half of the stitches made up, and every one believed: the map is torn, and they are listed."""
    recording = drive("odometry")
    assert recording.truth is not None
    default = config()
    loops = replace(default.loops, back_end="none", injected=0.5)
    torn = METHODS["slamstitch"](recording, replace(default, loops=loops))
    whole = METHODS["slamstitch"](recording, default)
    accepted = sum(tried.accepted for tried in whole.stitches)
    assert accepted > 0
    assert len(torn.stitches) == len(whole.stitches) + accepted
    assert error(torn.poses, recording.truth) > 5.0 * error(whole.poses, recording.truth)
