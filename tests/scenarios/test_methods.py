"""Every method, on a short drive: an answer for every scan, the same twice, and no look at the truth."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from scenarios.ablate.injection import map_with_false_stitches
from scenarios.methods import COMPARED, METHODS
from scenarios.methods.config import MethodConfig
from scenarios.methods.oracle import failures, with_true_failures
from scenarios.run import Options
from sim.laser import Raycaster
from slam import se2
from slam.cli import InputError
from slam.odometry.dead_reckoning import DeadReckoning
from slam.odometry.track import Track, Verdict
from slam.recording import Laser, Recording
from slam.se2 import Array
from stitch.align import Stitch
from stitch.mapping.estimate import Estimate

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
    slam = MethodConfig().slam
    lighter = replace(
        slam,
        loops=replace(slam.loops, length=2.0, candidates=2),
        bundle=replace(slam.bundle, neighbours=5, per_pass=3, radii=(0.4, 0.2)),
    )
    return MethodConfig(slam=lighter)


@pytest.fixture(scope="module")
def estimates() -> dict[tuple[str, str], Estimate]:
    """What every method says of the drive, by method and source."""
    return {(name, source): ask(name, drive(source)) for name in METHODS for source in ("ins", "odometry")}


def ask(name: str, recording: Recording) -> Estimate:
    """A method's answer, which it must have."""
    estimate = METHODS[name](recording, config())
    assert isinstance(estimate, Estimate)
    return estimate


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


@pytest.mark.parametrize("name", COMPARED)
@pytest.mark.parametrize("source", ["ins", "odometry"])
def test_the_truth_is_not_read(estimates: dict[tuple[str, str], Estimate], name: str, source: str) -> None:
    recording = drive(source)
    assert_same(ask(name, replace(recording, truth=None)), estimates[name, source])


@pytest.mark.parametrize("name", COMPARED)
def test_another_truth_changes_nothing_and_a_second_run_neither(
    estimates: dict[tuple[str, str], Estimate], name: str
) -> None:
    lie = np.random.default_rng(1).normal(0.0, 5.0, (N, 3))
    assert_same(ask(name, replace(drive("ins"), truth=lie)), estimates[name, "ins"])


@pytest.mark.parametrize("name", COMPARED)
@pytest.mark.parametrize("source", ["ins", "odometry"])
@pytest.mark.parametrize("scans", [1, 2, 9])
def test_where_nothing_can_be_matched_there_is_dead_reckoning(name: str, source: str, scans: int) -> None:
    whole = drive(source)
    ranges = whole.ranges[:scans].copy()
    ranges[1:] = np.nan
    short = replace(
        whole, time=whole.time[:scans], ranges=ranges, dead_reckoning=whole.dead_reckoning[:scans], truth=None
    )
    estimate = ask(name, short)
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


@pytest.mark.parametrize("name", [name for name, method in METHODS.items() if method.sees_truth])
def test_who_needs_the_truth_says_so_in_one_line(name: str) -> None:
    with pytest.raises(InputError, match=r"^oracle: expected a recording with truth, circle has none$"):
        METHODS[name](replace(drive("ins"), truth=None), config())


def test_nobody_is_told_the_truth_unasked() -> None:
    assert {"oracle", "slamstitch_online"} == set(METHODS) - set(COMPARED)
    assert Options().methods.split(",") == list(COMPARED)


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
    told = with_true_failures(DeadReckoning(recording), replace(track, poses=slid), truth, "trace2")
    np.testing.assert_allclose(told.poses, truth, atol=1e-12)
    np.testing.assert_array_equal(np.flatnonzero(told.verdict == Verdict.FELL_BACK), [4])
    np.testing.assert_array_equal(told.confidence["trace2"], [0, np.nan, 0, 0, np.inf, 0])


def test_injected_stitches_reach_the_graph(estimates: dict[tuple[str, str], Estimate]) -> None:
    """Half of the stitches made up, and every one believed: the map is torn, and they are listed."""
    recording = drive("odometry")
    assert recording.truth is not None
    mapping = config().slam
    mapping = replace(mapping, loops=replace(mapping.loops, back_end="none"))
    torn = map_with_false_stitches(recording, mapping, 0.5, np.random.default_rng(0))
    assert isinstance(torn, Estimate)
    whole = estimates["slamstitch", "odometry"]
    accepted = sum(tried.accepted for tried in whole.stitches)
    assert accepted > 0
    assert len(torn.stitches) == len(whole.stitches) + accepted
    assert error(torn.poses, recording.truth) > 5.0 * error(whole.poses, recording.truth)
