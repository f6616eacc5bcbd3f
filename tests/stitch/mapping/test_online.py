"""Scan by scan: causal, the same twice, as good as it can be, and not led astray by false stitches."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from scenarios.methods.config import MethodConfig
from sim.laser import Raycaster
from slam import se2
from slam.recording import Laser, Recording
from slam.se2 import Array
from stitch.align import NoStitch, Prior, Stitch, align
from stitch.mapping import online
from stitch.mapping.estimate import Estimate, Live
from stitch.mapping.online import Mapper

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


@pytest.fixture(scope="module")
def done() -> Estimate:
    return online.run(drive(), MethodConfig())


def test_a_pose_a_time_and_a_covariance_for_every_scan(done: Estimate) -> None:
    assert done.live is not None
    assert done.covariance is not None
    assert done.poses.shape == done.live.poses.shape == (N, 3)
    assert done.live.seconds.shape == (N,)
    assert np.all(done.live.seconds > 0.0)
    assert np.all(np.linalg.eigvalsh(done.covariance) > 0.0)
    assert all(0 <= s.start < s.stop <= N for s in done.submaps)
    assert not any(s.start <= k < s.stop for s in done.submaps for k in range(BLIND.start, BLIND.stop))


@pytest.mark.parametrize("n", [1, 12, 45, 62])
def test_what_comes_later_is_not_known_before(done: Estimate, n: int) -> None:
    """Poses given on the way are the same, to the last bit, though the recording ends early."""
    found = online.run(first(drive(), n), MethodConfig())
    assert found.live is not None
    assert done.live is not None
    np.testing.assert_array_equal(found.live.poses, done.live.poses[:n])


def test_it_maps_the_room(done: Estimate) -> None:
    truth, reckoned = drive().truth, drive().dead_reckoning
    assert truth is not None
    assert done.live is not None
    assert any(tried.accepted for tried in done.stitches)
    assert rms(done.poses, truth) < 0.5 * rms(reckoned, truth)
    assert rms(done.poses, truth) < 0.03
    assert rms(done.live.poses, truth) < rms(reckoned, truth)


def test_it_does_not_look_at_the_truth(done: Estimate) -> None:
    np.testing.assert_array_equal(online.run(replace(drive(), truth=None), MethodConfig()).poses, done.poses)


def test_false_stitches_are_found_out(done: Estimate) -> None:
    """Every third stitch is half a metre off; the map hardly notices, and each of them is dropped."""
    recording, config, tried = drive(), MethodConfig(), [0]
    true = partial(align, config=config.loops.align)

    def stitch(a: object, b: object, prior: Prior | None) -> Stitch | NoStitch:
        result = true(a, b, prior)  # type: ignore[arg-type]
        tried[0] += 1
        if tried[0] % 3 or not isinstance(result, Stitch):
            return result
        return replace(result, T_a_b=se2.compose(result.T_a_b, np.array([0.5, 0.3, 0.2])))

    mapper = Mapper(recording, config, stitch)
    poses = np.array([mapper.step() for _ in range(N)])
    found = mapper.estimate(Live(poses, np.ones(N)))
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
    found = online.run(replace(recording, ranges=ranges), MethodConfig())
    assert found.live is not None
    assert recording.truth is not None
    assert rms(found.live.poses, recording.truth) < 0.3


def test_without_dead_reckoning(done: Estimate) -> None:
    """The laser alone, up to where it is blinded."""
    recording = first(drive(), BLIND.start).without_dead_reckoning()
    found = online.run(recording, MethodConfig())
    assert found.live is not None
    assert recording.truth is not None
    assert rms(found.live.poses, recording.truth) < 0.05
