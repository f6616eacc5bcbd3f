"""Dead reckoning that lies is found out and done without, and an honest one is not doubted."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from slam import se2
from slam.matching import Match
from slam.matching.free_space import Sight
from slam.odometry.recovering_tracker import is_contradicted, track_recovering
from slam.odometry.recovery import Fit, RecoveryConfig, frozen_scans, saw_motion
from slam.odometry.track import Track, Verdict
from slam.odometry.tracker import FrontendConfig, track
from slam.recording import Recording
from slam.scan import scans_of
from slam.se2 import Array

FROZEN = slice(10, 20)
SLIPPED = [5, 24, 31, 40, 52]
CARRIED = 27
"""Scan after which the robot is carried on by more than a metre."""
STRANGE = slice(42, 47)
"""Scans of something that is nowhere in the room."""


def around() -> Array:
    """True poses ``(N, 3)`` on an ellipse in the room, nearly once and a half around, with a gap."""
    angle = np.delete(np.linspace(0.0, 2.8 * np.pi, 60), slice(CARRIED + 1, CARRIED + 6))
    x, y = 4.0 + 1.3 * np.sin(angle), 3.1 - 0.8 * np.cos(angle)
    return np.column_stack([x, y, np.arctan2(0.8 * np.sin(angle), 1.3 * np.cos(angle))])


def counted(lies: bool) -> Array:
    """What the wheels count of it, with noise; with ``lies`` nothing while frozen or carried, and four times
    as much where they slip."""
    steps = se2.between(around()[:-1], around()[1:])
    steps = steps + np.random.default_rng(1).normal(0.0, 0.003, steps.shape)
    if lies:
        steps[FROZEN] = 0.0
        steps[SLIPPED, :2] *= 4.0
        steps[CARRIED] = 0.0
    poses = [around()[0]]
    for step in steps:
        poses.append(se2.compose(poses[-1], step))
    return np.array(poses)


@pytest.fixture(scope="module")
def honest(room: Array, record: Callable[..., Recording]) -> Recording:
    return record(room, around(), counted(lies=False))


@pytest.fixture(scope="module")
def lying(room: Array, record: Callable[..., Recording]) -> Recording:
    recording = record(room, around(), counted(lies=True))
    phase = np.random.default_rng(3).uniform(0.0, 6.0, (STRANGE.stop - STRANGE.start, 1))
    recording.ranges[STRANGE] = 2.0 + np.sin(5.0 * recording.angles + phase)
    return recording


@pytest.fixture(scope="module")
def recover(lying: Recording) -> Callable[[RecoveryConfig], Track]:
    @cache
    def recover(config: RecoveryConfig) -> Track:
        return recovered(lying, config)

    return recover


def recovered(recording: Recording, config: RecoveryConfig) -> Track:
    return track_recovering(recording, FrontendConfig(), config, scans_of(recording))


def off(found: Track) -> Array:
    """Distances ``(N,)`` m from the truth."""
    return np.hypot(*se2.between(around(), found.poses)[:, :2].T)


def test_what_dead_reckoning_lies_about_the_laser_knows(
    lying: Recording, recover: Callable[..., Track], assert_consistent: Callable[[Track], None]
) -> None:
    found = recover(RecoveryConfig())
    assert_consistent(found)
    assert np.max(off(found)[: STRANGE.start]) < 0.05
    assert np.all(found.contradicted[FROZEN.start + 1 : FROZEN.stop])
    assert np.all(found.contradicted[[k + 1 for k in [*SLIPPED[:-1], CARRIED]]])
    assert np.all(found.verdict[STRANGE] == Verdict.FELL_BACK)
    assert np.all(found.contradicted[STRANGE])
    assert np.max(off(track(lying))[: STRANGE.start]) > 0.2


def test_an_honest_dead_reckoning_is_not_doubted(honest: Recording, lying: Recording) -> None:
    config = RecoveryConfig()
    plain, doubting = track(honest), recovered(honest, RecoveryConfig())
    assert not is_contradicted(honest, plain, config)
    assert not np.any(doubting.contradicted)
    assert np.max(off(doubting)) < 0.05
    assert is_contradicted(lying, track(lying), config)
    assert not is_contradicted(lying, track(lying), RecoveryConfig(min_contradictions=0))


def test_what_stands_still_though_the_laser_moved_is_frozen(honest: Recording, lying: Recording) -> None:
    still = np.r_[FROZEN.start + 1 : FROZEN.stop + 1, CARRIED + 1]
    np.testing.assert_array_equal(np.flatnonzero(frozen_scans(lying, RecoveryConfig())), still)
    assert not np.any(frozen_scans(honest, RecoveryConfig()))


def test_a_laser_that_stands_still_sees_no_motion(honest: Recording) -> None:
    config, rng = RecoveryConfig(), np.random.default_rng(2)
    still = honest.ranges[5] + rng.normal(0.0, 0.01, honest.ranges.shape[1])
    assert saw_motion(honest.ranges[5], honest.ranges[6], config)
    assert not saw_motion(honest.ranges[5], still, config)
    assert not saw_motion(honest.ranges[5], np.full_like(still, np.nan), config)


CHANGED: dict[str, object] = {
    "min_contradictions": 1000,
    "min_contradicted_share": 0.9,
    "prior_inflation": 1.0,
    "search_shift": 0.1,
    "search_turn": 1e-3,
    "max_violations": 0.0,
    "violation_loss": 1e3,
    "misfit_loss": 10.0,
    "min_fit": -5.0,
    "fit_tolerance": 5.0,
    "equal_share": 0.3,
    "margin": 0.02,
    "gap": 0.0,
    "min_points": 1000,
    "max_lost": 100,
    "still": 0.0,
    "changed_share": 1.0,
    "changed_range": 50.0,
    "min_beams": 1000,
}
"""Every setting, and a value with which something else is found."""


def outcome(name: str, recording: Recording, recover: Callable[..., Track], config: RecoveryConfig) -> Array:
    """What a setting decides."""
    ranges = recording.ranges
    if name.startswith("min_contra"):
        return np.array([is_contradicted(recording, track(recording), config)])
    if name in ("changed_share", "changed_range", "min_beams"):
        return np.array([saw_motion(ranges[5], ranges[6], config)])
    if name in ("violation_loss", "misfit_loss", "margin", "gap", "equal_share", "max_violations"):
        return judged(recording, config)
    found = recover(config)
    return np.column_stack([found.poses, found.contradicted])


def judged(recording: Recording, config: RecoveryConfig) -> Array:
    """What is said of a match half a metre off, which pairs a tenth more points than a right one."""
    scans, poses = scans_of(recording), around()
    sights = [Sight.of(scans[k], poses[k], np.zeros(3)) for k in (0, 2, 4)]
    fit = Fit(scans[6], np.zeros(3), sights, float(np.diff(recording.angles)[0]), config)
    right = Match.from_information(poses[6], np.eye(3), 90)
    right = replace(right, misfit=0.5)
    wrong = replace(right, T_reference_scan=se2.compose(poses[6], [0.05, 0.0, 0.0]), n_matches=100)
    best = fit.best([right, wrong], 0.0, poses[6])
    chosen = np.zeros(3) if best is None else best.T_reference_scan
    return np.array([*chosen, fit.of(wrong), fit.violates(wrong)])


@pytest.mark.parametrize("name", CHANGED)
def test_every_setting_of_the_recovery_changes_what_is_found(
    name: str, lying: Recording, recover: Callable[..., Track]
) -> None:
    default = RecoveryConfig()
    changed = replace(default, **{name: CHANGED[name]})
    before, after = (outcome(name, lying, recover, config) for config in (default, changed))
    assert not np.allclose(before, after)
