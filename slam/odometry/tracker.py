"""Recording → Track: every scan matched to what was seen just before."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from slam import se2
from slam.matching import RAW_WSM, LocalMap, Match, MatchConfig, NoMatch, Reference, match
from slam.matching.config import CovarianceMode, Method
from slam.odometry import confidence, dead_reckoning
from slam.odometry.calibration import Calibration
from slam.odometry.evidence import Evidence
from slam.odometry.track import Track, Verdict
from slam.recording import Recording
from slam.scan import Scan, stream
from slam.se2 import Array


@dataclass(frozen=True)
class FrontendConfig:
    """Settings of the front end.

    ``seed_mode``: the guess is the absolute dead-reckoned pose (ManifoldSLAM) or the last pose moved by
    the recorded increment. ``reference``: one scan, or the last ``map_scans`` keyframes. A scan is
    skipped until the robot moved ``skip_distance`` m on an axis or turned ``skip_angle`` rad, and becomes
    a keyframe ``extend_distance`` m or ``extend_angle`` rad away from the last one.
    ``trust_dead_reckoning`` weighs the increment as a prior in the match. Scans tilted more than
    ``tilt_limit`` rad from the recent attitude are not matched. A match with a variance above
    ``most_variance`` (mm² and rad² alike, as ManifoldSLAM has it) is not believed, nor one whose position is
    further from the seed than a χ² of ``most_innovation``: ten standard deviations are no accident, but
    something that moved, or another corridor. ``calibrate`` learns an INS's yaw scale, yaw bias and heading
    on the way.
    """

    seed_mode: Literal["absolute", "incremental"] = "incremental"
    reference: Literal["scan", "local_map"] = "local_map"
    method: Method = "plicp"
    covariance: CovarianceMode = "p2l"
    match: MatchConfig = field(default_factory=lambda: MatchConfig(fade=0.02, levels=((0.5, 2), (0.3, 1))))
    skip_distance: float = 0.0
    skip_angle: float = 0.0
    extend_distance: float = 0.25
    extend_angle: float = np.radians(8.0)
    map_scans: int = 20
    trust_dead_reckoning: bool = True
    tilt_limit: float = np.radians(5.0)
    most_variance: float = np.inf
    most_innovation: float = 100.0
    calibrate: bool = True


MANIFOLD_SLAM = FrontendConfig(
    seed_mode="absolute",
    reference="scan",
    method="wsm",
    covariance="pfister_block",
    match=RAW_WSM,
    skip_distance=0.02,
    skip_angle=np.radians(2.0),
    extend_distance=0.2,
    extend_angle=np.radians(5.0),
    trust_dead_reckoning=False,
    tilt_limit=np.inf,
    most_variance=10_000.0,
    most_innovation=np.inf,
    calibrate=False,
)
"""ManifoldSLAM as UsarCommander ran it for the report, including the absolute seed that tears its maps."""

FAR, FAR_TURN, ALWAYS = 2.0, np.radians(90.0), 1.01
"""Without dead reckoning: how far (m, rad) a match is looked for at most, and the share of points paired
below which one looks round."""

GIVEN_UP = 10
"""Scans without a match after which a robot without dead reckoning begins a new local map."""

LONGEST_COAST, COASTING = 1.0, 0.5
"""Seconds for which a robot is expected to go on as it did, and how much surer one is of that than of its
standing still."""


@dataclass(frozen=True)
class _Seed:
    """Where a scan is expected before it is looked at: pose ``(3,)``, and covariance ``(3, 3)`` of additive
    map-frame errors of the dead reckoning since the last scan."""

    pose: Array
    covariance: Array


@dataclass
class _State:
    """What the loop carries from scan to scan: the ``last`` that was tried, the last that is ``sure``."""

    poses: Array
    verdict: np.ndarray
    reference: np.ndarray
    covariance: Array
    evidence: Evidence
    information: Array
    matches: np.ndarray
    keyframes: list[int]
    local: Reference | LocalMap
    calibration: Calibration = field(default_factory=Calibration)
    last: int = 0
    sure: int = 0


def track(
    recording: Recording, config: FrontendConfig = FrontendConfig(), scans: Sequence[Scan] | None = None
) -> Track:
    """Pose, covariance and verdict for each of the N scans; the map frame is the dead reckoning's.

    ``scans`` are those of the recording, for a caller who has them already.
    """
    tracker = Tracker(recording, config, tilted_scans(recording, config.tilt_limit))
    for scan in stream(recording) if scans is None else scans:
        tracker.step(scan)
    return tracker.track()


class Tracker:
    """The front end scan by scan.

    ``tilted (N,)`` bool are the scans that are not matched. Of the recording's rows and of ``tilted`` a step
    reads those up to its own scan only.
    """

    def __init__(self, recording: Recording, config: FrontendConfig, tilted: np.ndarray) -> None:
        self.recording, self.tilted = recording, tilted
        self.config = config if recording.source != "none" else _looking_far(config)
        self._state = _start(recording, config)
        self._next = 0

    def step(self, scan: Scan) -> None:
        """Take in the next scan of the recording."""
        recording, state, config, k = self.recording, self._state, self.config, self._next
        self._next += 1
        if k == 0:
            _extend(state, scan, 0, config)
            return
        seed = _seed(recording, state, k, config)
        if not _moved(recording, state.last, k, config):
            state.poses[k] = state.poses[state.last]
            return
        result = NoMatch("tilted") if self.tilted[k] else _match(state, scan, seed, config)
        _accept(recording, state, k, seed, result, config)
        _note(recording, state, k, seed, scan, result, config)
        if recording.source == "none" and k - state.sure >= GIVEN_UP and len(scan) > 0:
            _start_anew(state, scan, k, config)
        elif _extends(state, k, config) and (config.reference == "scan" or not self.tilted[k]):
            _extend(state, scan, k, config)

    @property
    def poses(self) -> Array:
        """Poses ``(n, 3)`` of the scans so far."""
        return self._state.poses[: self._next]

    def track(self, since: int = 0) -> Track:
        """What was found of scans ``since`` to the last one so far."""
        return _finish(self._state, slice(since, self._next))


def tilted_scans(recording: Recording, limit: float, window: int = 101, centred: bool = True) -> np.ndarray:
    """Scans ``(N,)`` bool whose roll or pitch is more than ``limit`` rad off its running median.

    The INS's absolute tilt is useless after a shock; its change is not. ``centred``: the median is of as many
    scans before as after; otherwise of the scans so far, the first standing for those before it. All False
    without attitude.
    """
    from scipy.ndimage import median_filter

    if recording.attitude is None or not np.isfinite(limit):
        return np.zeros(len(recording), dtype=bool)
    unwrapped = np.unwrap(recording.attitude, axis=0)
    size, origin = (min(window, len(recording)), 0) if centred else (window, window // 2)
    recent = median_filter(unwrapped, size=(size, 1), mode="nearest", origin=(origin, 0))
    return np.any(np.abs(unwrapped - recent) > limit, axis=1)


def _start(recording: Recording, config: FrontendConfig) -> _State:
    n = len(recording)
    poses = np.zeros((n, 3))
    poses[0] = recording.dead_reckoning[0]
    return _State(
        poses=poses,
        verdict=np.full(n, Verdict.SKIPPED, dtype=np.int8),
        reference=np.full(n, -1, dtype=np.int64),
        covariance=np.full((n, 3, 3), np.nan),
        evidence=Evidence.empty(n),
        information=np.zeros((n, 3, 3)),
        matches=np.zeros(n, dtype=np.int64),
        keyframes=[],
        local=LocalMap(config.map_scans),
    )


def _looking_far(config: FrontendConfig) -> FrontendConfig:
    """The settings for a robot that nothing but its laser tells how it moved: no scan is matched without
    looking round for a better answer. A matcher that never looks round stays as it is."""
    if config.match.search_shift <= 0.0:
        return config
    far = replace(config.match, search_shift=FAR, search_turn=FAR_TURN, least_share=ALWAYS)
    return replace(config, match=far)


def _seed(recording: Recording, state: _State, k: int, config: FrontendConfig) -> _Seed:
    if recording.source == "none":
        return _coasted(recording, state, k)
    if config.seed_mode == "absolute":
        pose = recording.dead_reckoning[k]
    else:
        calibration = state.calibration if config.calibrate and recording.source == "ins" else None
        pose = dead_reckoning.predict(recording, state.last, k, state.poses[state.last], calibration)
    return _Seed(pose, dead_reckoning.map_covariance(recording, state.last, k, pose))


def _coasted(recording: Recording, state: _State, k: int) -> _Seed:
    """Where a robot without dead reckoning is expected: as fast on as it was, or at rest once it was lost."""
    j, i = state.last, int(state.reference[state.last])
    before, since = recording.time[j] - recording.time[i], recording.time[k] - recording.time[j]
    if j != state.sure or i < 0 or before <= 0.0 or not 0.0 < since < LONGEST_COAST:
        rest = dead_reckoning.predict(recording, j, k, state.poses[j])
        return _Seed(rest, dead_reckoning.map_covariance(recording, state.sure, k, rest))
    step = se2.log(se2.between(state.poses[i], state.poses[j]))
    pose = se2.compose(state.poses[j], se2.exp(step * min(since / before, 2.0)))
    return _Seed(pose, COASTING**2 * dead_reckoning.map_covariance(recording, j, k, pose))


def _start_anew(state: _State, scan: Scan, k: int, config: FrontendConfig) -> None:
    """A robot that has been lost for long sees places it has no map of: forget the local map."""
    state.sure = k
    if config.reference == "local_map":
        state.local = LocalMap(config.map_scans)
    _extend(state, scan, k, config)


def _moved(recording: Recording, j: int, k: int, config: FrontendConfig) -> bool:
    if config.skip_distance <= 0.0 and config.skip_angle <= 0.0:
        return True
    step = np.abs(se2.between(recording.dead_reckoning[j], recording.dead_reckoning[k]))
    return bool(np.any(step >= [config.skip_distance, config.skip_distance, config.skip_angle]))


def _extend(state: _State, scan: Scan, k: int, config: FrontendConfig) -> None:
    """Scan k becomes a keyframe: what is matched against from now on, alone in its own frame, or with the
    last ones in the map frame."""
    state.keyframes.append(k)
    if config.reference == "scan":
        state.local = Reference(scan)
    else:
        assert isinstance(state.local, LocalMap)
        state.local.add(scan, state.poses[k])


def _match(state: _State, scan: Scan, seed: _Seed, config: FrontendConfig) -> Match | NoMatch:
    """The scan's pose in the frame of what it is matched against."""
    prior = np.linalg.inv(seed.covariance) if config.trust_dead_reckoning else None
    guess = se2.between(_origin(state, config), seed.pose)
    return match(state.local, scan, guess, config.method, config.covariance, prior, config.match)


def _accept(
    recording: Recording,
    state: _State,
    k: int,
    seed: _Seed,
    result: Match | NoMatch,
    config: FrontendConfig,
) -> None:
    """Believe the match, or fall back to the seed with the dead reckoning's covariance."""
    state.reference[k] = state.keyframes[-1] if config.reference == "scan" else state.last
    state.matches[k] = result.n_matches
    if isinstance(result, Match) and _believed(state, seed, result, config):
        state.poses[k] = se2.compose(_origin(state, config), result.T_reference_scan)
        state.covariance[k] = result.covariance
        state.information[k] = se2.to_body_covariance(result.T_reference_scan, result.information)
        state.verdict[k] = Verdict.MATCHED
        state.sure = k
        if config.calibrate and recording.source == "ins":
            _learn(recording, state, k)
    else:
        state.poses[k] = seed.pose
        j = int(state.reference[k])
        state.covariance[k] = dead_reckoning.body_covariance(recording, j, k, seed.pose)
        state.verdict[k] = Verdict.FELL_BACK
    state.last = k


def _note(
    recording: Recording,
    state: _State,
    k: int,
    seed: _Seed,
    scan: Scan,
    result: Match | NoMatch,
    config: FrontendConfig,
) -> None:
    """Keep what the matcher left behind; a step is expected from its reference on, whatever the seed."""
    if isinstance(result, NoMatch):
        state.evidence.note_failure(k)
        return
    expected, covariance = seed.pose, seed.covariance
    if config.seed_mode == "absolute":
        j = int(state.reference[k])
        expected = dead_reckoning.predict(recording, j, k, state.poses[j])
        covariance = dead_reckoning.map_covariance(recording, j, k, expected)
    attitude = None if recording.attitude is None else recording.attitude[k]
    origin = _origin(state, config)
    state.evidence.note(k, result, len(scan), attitude, origin, expected, covariance)


def _believed(state: _State, seed: _Seed, result: Match, config: FrontendConfig) -> bool:
    variances = np.abs(np.diag(result.covariance)) * [1e6, 1e6, 1.0]
    if not result.converged or np.any(variances > config.most_variance):
        return False
    if np.isinf(config.most_innovation):
        return True
    innovation = (se2.compose(_origin(state, config), result.T_reference_scan) - seed.pose)[:2]
    return bool(innovation @ np.linalg.solve(seed.covariance[:2, :2], innovation) <= config.most_innovation)


def _origin(state: _State, config: FrontendConfig) -> Array:
    """Pose in the map of the frame that scans are matched in."""
    return state.poses[state.keyframes[-1]] if config.reference == "scan" else np.zeros(3)


def _learn(recording: Recording, state: _State, k: int) -> None:
    """What a step between two matched scans teaches about the INS."""
    j = state.last
    if j > 0 and state.verdict[j] != Verdict.MATCHED:
        return
    seconds = float(recording.time[k] - recording.time[j])
    sensed = recording.dead_reckoning[k] - recording.dead_reckoning[j]
    matched = state.poses[k] - state.poses[j]
    state.calibration.learn(sensed, seconds, matched, np.sqrt(np.abs(np.diag(state.covariance[k]))))


def _extends(state: _State, k: int, config: FrontendConfig) -> bool:
    step = np.abs(se2.between(state.poses[state.keyframes[-1]], state.poses[k]))
    return bool(np.any(step >= [config.extend_distance, config.extend_distance, config.extend_angle]))


def _finish(state: _State, part: slice) -> Track:
    return Track(
        state.poses[part], state.verdict[part], state.reference[part], state.covariance[part],
        state.information[part], state.matches[part], confidence.columns(state.evidence[part]),
    )  # fmt: skip
