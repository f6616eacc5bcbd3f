"""Spoilt dead reckoning, each kind against what it says, for wheels and for an INS."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sim.corruption import CORRUPTIONS
from slam import se2
from slam.recording import Laser, Recording
from slam.se2 import Array

N = 200
THERE, BACK = np.full(100, 0.1), np.full(99, -0.1)
STEPS = np.column_stack([np.concatenate([THERE, BACK]), np.zeros(N - 1), np.tile([0.02, 0.0], N)[: N - 1]])
"""In the body: a hundred forward, then backward; every second turns."""


def driven(steps: Array) -> Array:
    poses = [np.array([1.0, 2.0, 0.5])]
    for step in steps:
        poses.append(se2.compose(poses[-1], step))
    return np.array(poses)


def spoil(name: str, severity: float | None = None, source: str = "odometry", seed: int = 0) -> Recording:
    poses = driven(STEPS)
    recording = Recording(
        "made", 0.2 * np.arange(N), np.ones((N, 3)), np.arange(3.0), Laser(), poses, source,  # type: ignore[arg-type]
        truth=poses,
    )  # fmt: skip
    return CORRUPTIONS[name].at(severity).apply(recording, np.random.default_rng(seed))


def body_steps(recording: Recording) -> Array:
    return se2.between(recording.dead_reckoning[:-1], recording.dead_reckoning[1:])


def world_steps(recording: Recording) -> Array:
    return np.diff(recording.dead_reckoning[:, :2], axis=0)


@pytest.mark.parametrize("source", ["odometry", "ins"])
def test_the_sign_of_driving_backwards_is_lost(source: str) -> None:
    steps = body_steps(spoil("odometry.sign", source=source))
    np.testing.assert_allclose(steps, np.abs(STEPS), atol=1e-12)


def test_scales() -> None:
    np.testing.assert_allclose(
        body_steps(spoil("odometry.scale_distance", 0.8)), STEPS * [0.8, 1, 1], atol=1e-12
    )
    np.testing.assert_allclose(
        body_steps(spoil("odometry.scale_angle", 1.2)), STEPS * [1, 1, 1.2], atol=1e-12
    )


def test_the_turns_of_an_ins_do_not_turn_its_positions() -> None:
    wheels, ins = (spoil("odometry.scale_angle", 1.2, source) for source in ("odometry", "ins"))
    assert ins.truth is not None
    np.testing.assert_allclose(ins.dead_reckoning[:, :2], ins.truth[:, :2], atol=1e-12)
    np.testing.assert_allclose(ins.dead_reckoning[:, 2], wheels.dead_reckoning[:, 2], atol=1e-12)
    assert np.abs(wheels.dead_reckoning - ins.dead_reckoning)[:, :2].max() > 0.1


def test_drift_goes_with_the_distance() -> None:
    turned = body_steps(spoil("odometry.drift", 2.0))[:, 2] - STEPS[:, 2]
    np.testing.assert_allclose(turned, np.radians(0.2), atol=1e-12)


@pytest.mark.parametrize("share", [0.0, 0.1, 1.0])
def test_slip_takes_most_of_a_share_of_the_steps_in_bursts(share: float) -> None:
    kept = body_steps(spoil("odometry.slip", share))[:, 0] / STEPS[:, 0]
    slipping = kept < 0.99
    assert slipping.sum() == round(share * len(STEPS))
    assert np.all(kept[slipping] < 0.3 + 1e-9)
    assert np.all(kept[slipping] > -1e-9)
    np.testing.assert_allclose(kept[~slipping], 1.0)
    if share == 0.1:
        assert np.sum(slipping[1:] & slipping[:-1]) > 10  # of twenty; by chance there would be two


@pytest.mark.parametrize("source", ["odometry", "ins"])
def test_frozen_scans_stay_and_the_others_go_on(source: str) -> None:
    spoilt = spoil("odometry.frozen", 3, source)
    still = ~np.any(np.abs(body_steps(spoilt)) > 1e-9, axis=1)
    assert still.sum() == 60
    lengths = np.diff(np.flatnonzero(np.diff(np.concatenate([[0], still.astype(int), [0]]))))[::2]
    assert np.all(lengths % 20 == 0)
    if source == "ins":
        poses = driven(STEPS)
        np.testing.assert_allclose(
            world_steps(spoilt)[~still], np.diff(poses[:, :2], axis=0)[~still], atol=1e-12
        )
    else:
        np.testing.assert_allclose(body_steps(spoilt)[~still], STEPS[~still], atol=1e-12)


def test_late_and_early() -> None:
    poses = driven(STEPS)
    np.testing.assert_array_equal(spoil("odometry.late", 2).dead_reckoning, poses[[0, 0, *range(N - 2)]])
    np.testing.assert_array_equal(spoil("odometry.late", -1).dead_reckoning, poses[[*range(1, N), N - 1]])


def test_jumps_of_a_metre() -> None:
    off = np.linalg.norm((body_steps(spoil("odometry.jumps", 5)) - STEPS)[:, :2], axis=1)
    assert np.sum(off > 0.5) == 5
    np.testing.assert_allclose(off[off > 0.5], 1.0)
    np.testing.assert_allclose(off[off < 0.5], 0.0, atol=1e-12)


@pytest.mark.parametrize(("source", "taken_for"), [("odometry", "ins"), ("ins", "odometry")])
def test_the_frame_is_mistaken(source: str, taken_for: str) -> None:
    spoilt = spoil("odometry.frame", source=source)
    assert spoilt.source == taken_for
    np.testing.assert_array_equal(spoilt.dead_reckoning, driven(STEPS))


def test_quantised_poses_are_the_nearest_multiples() -> None:
    spoilt = spoil("odometry.quantised", 0.2).dead_reckoning
    off = spoilt - driven(STEPS)
    off[:, 2] = se2.wrap(off[:, 2])
    assert np.abs(off).max() <= 0.1 + 1e-9
    np.testing.assert_allclose(spoilt / 0.2, np.round(spoilt / 0.2), atol=1e-9)


def test_missing() -> None:
    assert spoil("odometry.missing").source == "none"


def test_a_late_stamp_takes_the_dead_reckoning_of_a_later_time() -> None:
    spoilt = spoil("laser.time", 0.1)
    middle = 0.5 * (driven(STEPS)[:-1] + driven(STEPS)[1:])
    np.testing.assert_allclose(spoilt.dead_reckoning[:-1], middle, atol=1e-9)
    np.testing.assert_array_equal(spoilt.time, 0.2 * np.arange(N))


def test_stamps_that_go_backwards_do_no_harm() -> None:
    poses = driven(STEPS)
    time = 0.2 * np.arange(N)
    time[50] -= 0.9
    recording = Recording("made", time, np.ones((N, 3)), np.arange(3.0), Laser(), poses, truth=poses)
    still = CORRUPTIONS["laser.time"].at(0.0).apply(recording, np.random.default_rng(0))
    np.testing.assert_allclose(still.dead_reckoning, poses, atol=1e-12)
    tilted = replace(recording, attitude=np.column_stack([time, np.zeros(N)]) / 100.0)
    later = CORRUPTIONS["laser.time"].at(0.2).apply(tilted, np.random.default_rng(0))
    assert later.attitude is not None
    np.testing.assert_allclose(later.attitude[:40, 0], time[1:41] / 100.0)
