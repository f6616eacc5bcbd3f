"""Scan by scan: causal, the same twice, as good as it can be, and not led astray by false stitches."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import pytest
from scipy.stats import chi2

from sim.laser import Raycaster
from slam import se2
from slam.odometry.track import Verdict
from slam.recording import Laser, Recording
from slam.scan import Scan
from slam.se2 import Array
from stitch.align import NoStitch, Prior, Stitch, align
from stitch.mapping import Estimate, MappingConfig, NoEstimate, OnlineMapper, replay_online

ANGLES = np.radians(np.linspace(-110.0, 110.0, 111))
LASER = Laser(range_max=8.0)
N, TURNS = 100, 2.1
BLIND = slice(40, 43)


def box(x0: float, y0: float, x1: float, y1: float) -> list[list[float]]:
    return [[x0, y0, x1, y0], [x1, y0, x1, y1], [x1, y1, x0, y1], [x0, y1, x0, y0]]


def drive() -> Recording:
    """Twice round a room, blind for three scans; an INS whose yaw drifts."""
    rng = np.random.default_rng(4)
    angle = np.linspace(0.0, TURNS * 2.0 * np.pi, N)
    x, y = 3.0 + 1.7 * np.sin(angle), 2.5 - 1.4 * np.cos(angle)
    truth = np.column_stack([x, y, np.arctan2(1.4 * np.sin(angle), 1.7 * np.cos(angle))])
    walls = np.array([*box(0, 0, 6, 5), *box(2.6, 2, 3.4, 3), *box(4.8, 0, 6, 0.7), [0, 3.3, 0.8, 3.3]])
    ranges = Raycaster.from_segments(walls).cast(truth, ANGLES, LASER.range_max)
    ranges = ranges + rng.normal(0.0, 0.01, ranges.shape)
    ranges[BLIND] = np.nan
    walk = np.cumsum(rng.normal(0.0, 0.005, (N, 2)), axis=0)
    yaw = se2.wrap(truth[0, 2] + 1.03 * (np.unwrap(truth[:, 2]) - truth[0, 2]))
    reckoned = np.column_stack([truth[:, :2] + walk, yaw])
    attitude = np.zeros((N, 2))
    attitude[60:68, 0] = np.radians(9.0)
    return Recording(
        "rounds", 0.2 * np.arange(N), ranges, ANGLES, LASER, reckoned, "ins", None, attitude, truth
    )


def first(recording: Recording, n: int) -> Recording:
    """The recording's first n scans."""
    parts = ("time", "ranges", "dead_reckoning", "attitude", "truth")
    return replace(recording, **{name: getattr(recording, name)[:n] for name in parts})


def rms(poses: Array, truth: Array) -> float:
    apart = se2.between(poses[0], poses)[:, :2] - se2.between(truth[0], truth)[:, :2]
    return float(np.sqrt(np.mean(np.sum(apart**2, axis=1))))


def replay(recording: Recording) -> Estimate:
    estimate = replay_online(recording)
    assert isinstance(estimate, Estimate)
    return estimate


def scans(recording: Recording) -> Iterator[tuple[Array, float, Array, Array]]:
    """What the robot's drivers give, scan by scan."""
    assert recording.attitude is not None
    for k in range(len(recording)):
        yield (
            recording.ranges[k].copy(),
            float(recording.time[k]),
            recording.dead_reckoning[k].copy(),
            recording.attitude[k].copy(),
        )


@pytest.fixture(scope="module")
def done() -> Estimate:
    return replay(drive())


def test_a_pose_a_time_and_a_covariance_for_every_scan(done: Estimate) -> None:
    assert done.online is not None
    assert done.covariance is not None
    assert done.poses.shape == done.online.poses.shape == (N, 3)
    assert done.online.seconds.shape == (N,)
    assert np.all(done.online.seconds > 0.0)
    assert np.all(np.linalg.eigvalsh(done.covariance) > 0.0)
    assert all(0 <= s.start < s.stop <= N for s in done.submaps)
    assert not any(s.start <= k < s.stop for s in done.submaps for k in range(BLIND.start, BLIND.stop))


@pytest.mark.parametrize("n", [1, 12, 45, 62])
def test_what_comes_later_is_not_known_before(done: Estimate, n: int) -> None:
    """Poses given on the way are the same, to the last bit, though the recording ends early."""
    found = replay(first(drive(), n))
    assert found.online is not None
    assert done.online is not None
    np.testing.assert_array_equal(found.online.poses, done.online.poses[:n])


def test_it_maps_the_room(done: Estimate) -> None:
    truth, reckoned = drive().truth, drive().dead_reckoning
    assert truth is not None
    assert done.online is not None
    assert any(tried.accepted for tried in done.stitches)
    assert rms(done.poses, truth) < 0.5 * rms(reckoned, truth)
    assert rms(done.poses, truth) < 0.03
    assert rms(done.online.poses, truth) < rms(reckoned, truth)


def test_it_does_not_look_at_the_truth(done: Estimate) -> None:
    np.testing.assert_array_equal(replay(replace(drive(), truth=None)).poses, done.poses)


def test_false_stitches_are_found_out(done: Estimate) -> None:
    """Every third stitch is half a metre off; the map hardly notices, and each of them is dropped."""
    recording, config, tried = drive(), MappingConfig(), [0]
    true = partial(align, config=config.loops.align)

    def stitch(a: object, b: object, prior: Prior | None) -> Stitch | NoStitch:
        result = true(a, b, prior)  # type: ignore[arg-type]
        tried[0] += 1
        if tried[0] % 3 or not isinstance(result, Stitch):
            return result
        return replace(result, T_a_b=se2.compose(result.T_a_b, np.array([0.5, 0.3, 0.2])))

    mapper = OnlineMapper(LASER, ANGLES, config, "ins", stitch)
    for scan in scans(recording):
        mapper.process(*scan)
    found = mapper.estimate()
    assert recording.truth is not None
    false = [one for k, one in enumerate(found.stitches) if k % 3 == 2 and isinstance(one.result, Stitch)]
    assert false
    assert not any(one.accepted for one in false)
    assert rms(found.poses, recording.truth) < rms(done.poses, recording.truth) + 0.02


@pytest.mark.parametrize("blind", [slice(0, 60), slice(0, 5), slice(30, 60), slice(1, 60)])
def test_a_blind_laser_ends_nothing(blind: slice) -> None:
    recording = first(drive(), 60)
    ranges = recording.ranges.copy()
    ranges[blind] = np.nan
    found = replay(replace(recording, ranges=ranges))
    assert found.online is not None
    assert recording.truth is not None
    assert rms(found.online.poses, recording.truth) < 0.3


def test_without_dead_reckoning(done: Estimate) -> None:
    """The laser alone, up to where it is blinded."""
    recording = first(drive(), BLIND.start).without_dead_reckoning()
    found = replay(recording)
    assert found.online is not None
    assert recording.truth is not None
    assert rms(found.online.poses, recording.truth) < 0.05


def test_fed_scan_by_scan_from_a_generator_it_says_what_the_replay_says(done: Estimate) -> None:
    """It sees no recording, and what it was given may be overwritten afterwards."""
    mapper = OnlineMapper(LASER, ANGLES, source="ins")
    poses = []
    for ranges, time, dead_reckoning, attitude in scans(drive()):
        pose = mapper.process(ranges, time, dead_reckoning, attitude)
        ranges[:], dead_reckoning[:], attitude[:] = np.nan, np.nan, np.nan
        poses.append(pose.pose)
        assert np.all(np.linalg.eigvalsh(pose.covariance) > 0.0)
    assert done.online is not None
    np.testing.assert_array_equal(poses, done.online.poses)
    np.testing.assert_array_equal(mapper.estimate().poses, done.poses)


def test_each_pose_has_the_verdict_of_its_scan(done: Estimate) -> None:
    assert done.track is not None
    mapper = OnlineMapper(LASER, ANGLES, source="ins")
    verdicts = [mapper.process(*scan).verdict for scan in scans(drive())]
    assert verdicts == done.track.verdict.tolist()
    assert Verdict.FELL_BACK in verdicts[BLIND]


def test_while_it_is_lost_it_knows_less_and_less() -> None:
    mapper = OnlineMapper(LASER, ANGLES, source="ins")
    sigma = [float(np.trace(mapper.process(*scan).covariance[:2, :2])) for scan in scans(first(drive(), 44))]
    assert sigma[BLIND.start - 1] < sigma[BLIND.start] < sigma[BLIND.start + 1]


def test_covariances_on_the_way_are_honest(done: Estimate) -> None:
    """NEES of the poses given on the way, in the body tangent. One drive's errors are correlated, so that its
    mean may lie as high as a single pose's: below χ²₃(0.99)."""
    truth = drive().truth
    assert truth is not None
    mapper = OnlineMapper(LASER, ANGLES, source="ins")
    poses = [mapper.process(*scan) for scan in scans(drive())]
    start = se2.compose(poses[0].pose, se2.inverse(truth[0]))
    errors = [se2.log(se2.between(se2.compose(start, t), p.pose)) for t, p in zip(truth, poses, strict=True)]
    nees = [e @ np.linalg.solve(p.covariance, e) for e, p in zip(errors[1:], poses[1:], strict=True)]
    assert np.mean(nees) < chi2.ppf(0.99, 3)


def test_a_scan_made_already_serves_as_well_as_its_ranges() -> None:
    recording = first(drive(), 30)
    of_ranges, of_scans = (OnlineMapper(LASER, ANGLES, source="ins") for _ in range(2))
    for ranges, *others in scans(recording):
        expected = of_ranges.process(ranges, *others)
        pose = of_scans.process(Scan.from_ranges(ranges, ANGLES, LASER), *others)
        np.testing.assert_allclose(pose.pose, expected.pose, atol=1e-3)  # its grids are drawn from points
    np.testing.assert_allclose(of_scans.measurements.ranges, recording.ranges, atol=0.05)


GOOD = (np.ones(111), 1.0, np.zeros(3), np.zeros(2))


@pytest.mark.parametrize(
    ("bad", "complaint"),
    [
        ((np.ones(110), 1.0, np.zeros(3), np.zeros(2)), r"ranges: expected shape \(111,\), got \(110,\)"),
        (
            (np.ones(111), 0.5, np.zeros(3), np.zeros(2)),
            "time: expected at least 1 s, the last scan's, got 0.5 s",
        ),
        ((np.ones(111), np.nan, np.zeros(3), np.zeros(2)), "time: expected finite"),
        ((np.ones(111), 2.0, np.array([0, np.nan, 0]), np.zeros(2)), "dead_reckoning: expected finite"),
        ((np.ones(111), 2.0, np.zeros(2), np.zeros(2)), r"dead_reckoning: expected shape \(3,\)"),
        ((np.ones(111), 2.0, None, np.zeros(2)), "dead_reckoning: got None, but the source is 'ins'"),
        ((np.ones(111), 2.0, np.zeros(3), None), "attitude: expected for every scan or for none"),
        ((np.ones(111), 2.0, np.zeros(3), np.array([np.inf, 0])), "attitude: expected finite"),
    ],
)
def test_a_scan_that_cannot_be_used_is_named_and_ignored(bad: tuple[Any, ...], complaint: str) -> None:
    mapper, other = (OnlineMapper(LASER, ANGLES, source="ins") for _ in range(2))
    mapper.process(*GOOD)
    other.process(*GOOD)
    with pytest.raises(ValueError, match=complaint):
        mapper.process(*bad)
    after = (np.full(111, 1.01), 1.2, np.array([0.05, 0.0, 0.0]), np.zeros(2))
    np.testing.assert_array_equal(mapper.process(*after).pose, other.process(*after).pose)
    assert len(mapper.estimate().poses) == 2


def test_before_the_first_scan_there_is_no_estimate() -> None:
    with pytest.raises(ValueError, match="at least one scan"):
        OnlineMapper(LASER, ANGLES).estimate()


def test_a_map_that_knows_it_is_lost_is_refused() -> None:
    recording = first(drive(), 60).without_dead_reckoning()
    ranges = recording.ranges.copy()
    ranges[10:] = np.nan
    estimate = replay_online(replace(recording, ranges=ranges))
    assert isinstance(estimate, NoEstimate)
    assert "of the scans could be matched" in estimate.reason


def test_where_no_match_is_believed_a_submap_is_drawn_of_its_first_scan() -> None:
    config = MappingConfig()
    config = replace(config, frontend=replace(config.frontend, max_variance=0.0))
    found = replay_online(first(drive(), 40), config)
    assert isinstance(found, Estimate)
    assert found.submaps
    assert all(submap.rows.tolist() == [submap.start] for submap in found.submaps[1:])
    np.testing.assert_allclose(found.poses, first(drive(), 40).dead_reckoning, atol=0.05)


def test_stamps_that_go_backwards_are_held() -> None:
    """Some logs' do; odometry's increments do not care."""
    recording = replace(first(drive(), 40), source="odometry")
    back = recording.time.copy()
    back[20] -= 0.9
    np.testing.assert_array_equal(replay(replace(recording, time=back)).poses, replay(recording).poses)
