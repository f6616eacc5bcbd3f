"""How exact the wheels are, as the matches of a drive tell."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from slam import se2
from slam.odometry.dead_reckoning import DeadReckoning, DeadReckoningConfig
from slam.odometry.odometry_noise import OdometryNoiseConfig, noise_scale, scaled
from slam.odometry.track import Track, Verdict
from slam.recording import Laser, Recording
from slam.se2 import Array

SCANS = 400
USUAL = DeadReckoningConfig()


def chained(steps: Array) -> Array:
    poses = [np.zeros(3)]
    for step in steps:
        poses.append(se2.compose(poses[-1], step))
    return np.array(poses)


def driven(scale: float) -> tuple[Recording, Track]:
    """A drive whose wheels have ``scale`` times the usual noise, and its exact track."""
    rng = np.random.default_rng(0)
    n = SCANS - 1
    steps = np.column_stack([rng.uniform(0.1, 0.4, n), np.zeros(n), 0.2 * rng.standard_normal(n)])
    recording = recorded(chained(steps))
    k = np.arange(n)
    covariance = DeadReckoning(recording, USUAL).step_covariance(k, k + 1)
    sigma = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    counted = steps + scale * sigma * rng.standard_normal(steps.shape)
    return recorded(chained(counted)), tracked(chained(steps))


def recorded(poses: Array) -> Recording:
    ranges = np.ones((len(poses), 3))
    return Recording("made", np.arange(len(poses)), ranges, np.arange(3.0), Laser(), poses)


def tracked(poses: Array, sigma: float = 0.002) -> Track:
    none = np.full((SCANS, 3, 3), np.nan)
    surely = np.tile(np.eye(3) / sigma**2, (SCANS, 1, 1))
    verdict = np.full(SCANS, Verdict.MATCHED)
    return Track(poses, verdict, np.arange(SCANS) - 1, none, surely, np.zeros(SCANS), {})


@pytest.mark.parametrize("scale", [0.15, 0.2])
def test_the_noise_of_exact_wheels_is_found(scale: float) -> None:
    found = noise_scale(*driven(scale))
    assert found == pytest.approx(scale, rel=0.15)


def test_usual_wheels_are_left_alone_and_perfect_ones_not_believed_to_be() -> None:
    assert noise_scale(*driven(0.6)) == 1.0
    assert noise_scale(*driven(2.0)) == 1.0
    assert noise_scale(*driven(0.0)) == OdometryNoiseConfig().min_scale


def test_matches_that_do_not_know_their_place_tell_nothing() -> None:
    recording, track = driven(0.15)
    assert noise_scale(recording, tracked(track.poses, sigma=0.02)) == 1.0
    lost = replace(track, verdict=np.full(SCANS, Verdict.FELL_BACK))
    assert noise_scale(recording, lost) == 1.0


def test_all_noise_of_wheels_is_scaled_and_nothing_else() -> None:
    poses = np.array([[0.0, 0.0, 0.0], [0.3, 0.1, 0.4]])
    usual, exact = (
        DeadReckoning(recorded(poses), config).step_covariance(0, 1) for config in (USUAL, scaled(USUAL, 0.1))
    )
    np.testing.assert_allclose(exact, 0.01 * usual)
    assert scaled(USUAL, 0.1).ins_walk == USUAL.ins_walk


CHANGED = {
    "max_scale": 0.1,
    "min_scale": 0.19,
    "max_match_sigma": 0.001,
    "min_motion": 1.0,
    "min_steps": 1000,
}
"""Every setting, and a value with which another scale is found."""


@pytest.mark.parametrize("name", CHANGED)
def test_every_setting_changes_the_scale(name: str) -> None:
    recording, track = driven(0.15)
    default = OdometryNoiseConfig()
    changed = replace(default, **{name: CHANGED[name]})
    assert noise_scale(recording, track, USUAL, default) != noise_scale(recording, track, USUAL, changed)
