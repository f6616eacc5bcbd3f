"""Every method, on a short drive: an answer for every scan, the same twice, and no look at the truth."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from scenarios.estimate import Estimate
from scenarios.methods import METHODS
from scenarios.methods.config import MethodConfig
from scenarios.methods.slamstitch import chop
from sim.laser import Raycaster
from slam import se2
from slam.recording import Laser, Recording
from slam.se2 import Array
from slam.segmentation import Segment
from slam.track import Track, Verdict

ANGLES = np.radians(np.linspace(-110.0, 110.0, 111))
LASER = Laser(range_max=8.0)
SEES_TRUTH = {"oracle"}
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


@pytest.mark.parametrize("name", sorted(set(METHODS) - SEES_TRUTH))
@pytest.mark.parametrize("source", ["ins", "odometry"])
def test_the_truth_is_not_read(estimates: dict[tuple[str, str], Estimate], name: str, source: str) -> None:
    recording = drive(source)
    assert_same(METHODS[name](replace(recording, truth=None), config()), estimates[name, source])


@pytest.mark.parametrize("name", sorted(set(METHODS) - SEES_TRUTH))
def test_another_truth_changes_nothing_and_a_second_run_neither(
    estimates: dict[tuple[str, str], Estimate], name: str
) -> None:
    lie = np.random.default_rng(1).normal(0.0, 5.0, (N, 3))
    assert_same(METHODS[name](replace(drive("ins"), truth=lie), config()), estimates[name, "ins"])


@pytest.mark.parametrize("name", sorted(set(METHODS) - SEES_TRUTH))
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
