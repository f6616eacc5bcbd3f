"""Recording → Track: every scan matched to what was seen just before."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal, TypeGuard

import numpy as np

from slam import se2
from slam.matching import RAW_WSM, LocalMap, Match, MatchConfig, NoMatch, Reference, match
from slam.matching.config import CovarianceMode, Method
from slam.matching.match import register
from slam.measurements import Measurements
from slam.odometry.calibration import Calibration, CalibrationConfig
from slam.odometry.confidence import compute_measures
from slam.odometry.dead_reckoning import DeadReckoning, DeadReckoningConfig
from slam.odometry.match_statistics import MatchStatistics
from slam.odometry.tilt import tilted_scans
from slam.odometry.track import Track, Verdict
from slam.recording import Recording
from slam.scan import Scan, ScanConfig, stream
from slam.se2 import Array

ALWAYS = 1.01
"""A share of paired points below which the matcher looks elsewhere, and which no match reaches."""


@dataclass(frozen=True)
class LaserOnlyConfig:
    """Tracking without dead reckoning."""

    search_shift: float = 2.0
    """How far [m] a match is looked for at most."""
    search_turn: float = np.radians(90.0)
    """How far [rad] a match is looked for at most."""
    max_unmatched: int = 10
    """Scans without a match after which a new local map begins."""
    max_coasting: float = 1.0
    """Seconds for which a robot is expected to go on at constant velocity."""
    coasting_sigma: float = 0.5
    """Standard deviation of the constant-velocity prediction, as a share of that of standing still."""


@dataclass(frozen=True)
class FrontendConfig:
    """The front end: tracking scan by scan. Raises ``ValueError`` for an unknown matcher."""

    scan: ScanConfig = field(default_factory=ScanConfig)
    """How surfaces and uncertainties are read off the ranges."""
    seed_mode: Literal["absolute", "incremental"] = "incremental"
    """The guess: the absolute dead-reckoned pose (ManifoldSLAM), or the last pose moved by the increment."""
    reference: Literal["scan", "local_map"] = "local_map"
    """What a scan is matched to: the last keyframe, or the last ``map_scans`` of them."""
    method: Method = "plicp"
    """Scan matcher, by its name in the registry."""
    covariance: CovarianceMode = "p2l"
    """Which covariance the matcher claims."""
    match: MatchConfig = field(default_factory=lambda: MatchConfig(fade=0.02, levels=((0.5, 2), (0.3, 1))))
    """The matcher's settings."""
    skip_distance: float = 0.0
    """A scan is skipped until the robot moved this far [m] on an axis …"""
    skip_angle: float = 0.0
    """… or turned by this [rad]; where either is 0 none is skipped."""
    extend_distance: float = 0.25
    """A scan becomes a keyframe of the local map this far [m] from the last one …"""
    extend_angle: float = np.radians(8.0)
    """… or turned by this [rad]."""
    map_scans: int = 20
    """Keyframes in the local map."""
    trust_dead_reckoning: bool = True
    """Whether dead reckoning's increment is a prior in the match."""
    tilt_limit: float = np.radians(5.0)
    """A scan tilted more than this [rad] from the recent attitude is not matched."""
    tilt_window: int = 101
    """Scans whose median is the recent attitude."""
    max_variance: float = np.inf
    """A match with a larger variance (mm² and rad² alike, as ManifoldSLAM has it) is not believed."""
    max_innovation: float = 100.0
    """A match further from the seed (χ² of its position) is not believed: ten standard deviations are no
    accident, but something that moved, or another corridor."""
    calibrate: bool = True
    """Whether an INS's yaw scale, yaw bias and heading are learnt on the way."""
    calibration: CalibrationConfig = field(default_factory=CalibrationConfig)
    """How they are learnt."""
    dead_reckoning: DeadReckoningConfig = field(default_factory=DeadReckoningConfig)
    """Noise of the dead reckoning."""
    laser_only: LaserOnlyConfig = field(default_factory=LaserOnlyConfig)
    """What changes without dead reckoning."""

    def __post_init__(self) -> None:
        register(self.method)


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
    max_variance=10_000.0,
    max_innovation=np.inf,
    calibrate=False,
)
"""ManifoldSLAM as UsarCommander ran it for the thesis, including the absolute seed that tears its maps."""


@dataclass(frozen=True)
class Seed:
    """Where a scan is expected before it is looked at: pose ``(3,)``, and covariance ``(3, 3)`` of additive
    map-frame errors of the dead reckoning since the last scan."""

    pose: Array
    covariance: Array


@dataclass
class _Steps:
    """The track of n scans so far, by column, with room for more."""

    poses: Array
    verdict: np.ndarray
    reference: np.ndarray
    covariance: Array
    information: Array
    matches: np.ndarray
    contradicted: np.ndarray
    statistics: MatchStatistics

    @classmethod
    def empty(cls, n: int) -> _Steps:
        """Room for n scans, all skipped as yet."""
        return cls(
            poses=np.zeros((n, 3)),
            verdict=np.full(n, Verdict.SKIPPED, dtype=np.int8),
            reference=np.full(n, -1, dtype=np.int64),
            covariance=np.full((n, 3, 3), np.nan),
            information=np.zeros((n, 3, 3)),
            matches=np.zeros(n, dtype=np.int64),
            contradicted=np.zeros(n, dtype=bool),
            statistics=MatchStatistics.empty(n),
        )

    def extended(self, n: int) -> _Steps:
        """The same with room for n scans."""
        room = _Steps.empty(n - len(self.poses))
        names = ("poses", "verdict", "reference", "covariance", "information", "matches", "contradicted")
        columns = {name: np.concatenate([getattr(self, name), getattr(room, name)]) for name in names}
        return _Steps(**columns, statistics=self.statistics.extended(n))


def track(
    recording: Recording, config: FrontendConfig = FrontendConfig(), scans: Sequence[Scan] | None = None
) -> Track:
    """Pose, covariance and verdict for each of the N scans; the map frame is the dead reckoning's.

    ``scans`` are those of the recording, for a caller who has them already.
    """
    tilted = tilted_scans(recording, config.tilt_limit, config.tilt_window)
    tracker = Tracker(recording, config, room=len(recording))
    for scan, is_tilted in zip(
        stream(recording, config.scan) if scans is None else scans, tilted, strict=True
    ):
        tracker.step(scan, is_tilted)
    return tracker.track()


class Tracker:
    """The front end scan by scan.

    ``measurements`` may grow from step to step; a step reads their rows up to its own scan only. ``room`` is
    made for so many scans at first.
    """

    def __init__(self, measurements: Measurements, config: FrontendConfig, room: int = 256) -> None:
        self.measurements = measurements
        self.reckoning = DeadReckoning(measurements, config.dead_reckoning)
        self.config = _with_wide_search(config) if self.reckoning.absent else config
        self._steps = _Steps.empty(room)
        self._count = 0
        self._keyframes: list[int] = []
        self._local: Reference | LocalMap = LocalMap(config.map_scans)
        self._calibration = Calibration(config.calibration)
        self._last = 0
        self._last_matched = 0

    def step(self, scan: Scan, tilted: bool = False) -> None:
        """Take in the next scan; a ``tilted`` one is not matched."""
        k = self._count
        if k == len(self._steps.poses):
            self._steps = self._steps.extended(2 * k)
        self._count += 1
        if k == 0:
            self._steps.poses[0] = self.reckoning.poses[0]
            self._add_keyframe(scan, 0)
            return
        if not self._has_moved(k):
            self._steps.poses[k] = self._steps.poses[self._last]
            return
        seed = self._predict(k)
        result = NoMatch("tilted") if tilted else self._match(scan, seed)
        result, believed = self._judge(k, scan, seed, result)
        self._accept(k, seed, result, believed)
        self._record_statistics(k, seed, scan, result)
        self._extend_map(k, scan, tilted)

    @property
    def poses(self) -> Array:
        """Poses ``(n, 3)`` of the scans so far."""
        return self._steps.poses[: self._count]

    def track(self, since: int = 0, measures: Collection[str] | None = None) -> Track:
        """The track of scans ``since`` to the last one so far, with all measures of confidence or some."""
        steps, part = self._steps, slice(since, self._count)
        return Track(
            steps.poses[part], steps.verdict[part], steps.reference[part], steps.covariance[part],
            steps.information[part], steps.matches[part],
            compute_measures(steps.statistics[part], measures), steps.contradicted[part],
        )  # fmt: skip

    def _has_moved(self, k: int) -> bool:
        config, poses = self.config, self.reckoning.poses
        if config.skip_distance <= 0.0 and config.skip_angle <= 0.0:
            return True
        step = np.abs(se2.between(poses[self._last], poses[k]))
        return bool(np.any(step >= [config.skip_distance, config.skip_distance, config.skip_angle]))

    def _predict(self, k: int) -> Seed:
        config, reckoning, j = self.config, self.reckoning, self._last
        if reckoning.absent:
            return self._coast(k)
        if config.seed_mode == "absolute":
            pose = reckoning.poses[k]
        else:
            calibration = self._calibration if config.calibrate and reckoning.in_world else None
            pose = reckoning.predict(j, k, self._steps.poses[j], calibration)
        return Seed(pose, reckoning.map_covariance(j, k, pose))

    def _coast(self, k: int) -> Seed:
        """Where a robot without dead reckoning is expected: at constant velocity, or at rest once it was
        lost."""
        config, reckoning, poses = self.config.laser_only, self.reckoning, self._steps.poses
        j, i = self._last, int(self._steps.reference[self._last])
        before, since = reckoning.seconds(i, j), reckoning.seconds(j, k)
        if j != self._last_matched or i < 0 or before <= 0.0 or not 0.0 < since < config.max_coasting:
            rest = reckoning.predict(j, k, poses[j])
            return Seed(rest, reckoning.map_covariance(self._last_matched, k, rest))
        step = se2.log(se2.between(poses[i], poses[j]))
        pose = se2.compose(poses[j], se2.exp(step * min(since / before, 2.0)))
        return Seed(pose, config.coasting_sigma**2 * reckoning.map_covariance(j, k, pose))

    def _match(self, scan: Scan, seed: Seed) -> Match | NoMatch:
        """The scan's pose in the frame of what it is matched against."""
        config = self.config
        prior = np.linalg.inv(seed.covariance) if config.trust_dead_reckoning else None
        guess = se2.between(self._origin(), seed.pose)
        return match(self._local, scan, guess, config.method, config.covariance, prior, config.match)

    def _judge(self, k: int, scan: Scan, seed: Seed, result: Match | NoMatch) -> tuple[Match | NoMatch, bool]:
        """The answer for scan k, and whether it is believed."""
        sound = self._is_sound(result)
        agrees = self._is_sound(result) and self._agrees(seed, result)
        self._steps.contradicted[k] = sound and not agrees
        return result, agrees

    def _accept(self, k: int, seed: Seed, result: Match | NoMatch, believed: bool) -> None:
        """Take the match, or fall back to the seed with the dead reckoning's covariance."""
        steps, reckoning = self._steps, self.reckoning
        steps.reference[k] = self._keyframes[-1] if self.config.reference == "scan" else self._last
        steps.matches[k] = result.n_matches
        if isinstance(result, Match) and believed:
            steps.poses[k] = se2.compose(self._origin(), result.T_reference_scan)
            steps.covariance[k] = result.covariance
            steps.information[k] = se2.to_body_covariance(result.T_reference_scan, result.information)
            steps.verdict[k] = Verdict.MATCHED
            self._last_matched = k
            if self.config.calibrate and reckoning.in_world:
                self._calibrate(k)
        else:
            steps.poses[k] = seed.pose
            steps.covariance[k] = reckoning.body_covariance(int(steps.reference[k]), k, seed.pose)
            steps.verdict[k] = Verdict.FELL_BACK
        self._last = k

    def _is_sound(self, result: Match | NoMatch) -> TypeGuard[Match]:
        """Whether a match is one that the matcher itself believes."""
        if isinstance(result, NoMatch) or not result.converged:
            return False
        variances = np.abs(np.diag(result.covariance)) * [1e6, 1e6, 1.0]
        return bool(np.all(variances <= self.config.max_variance))

    def _agrees(self, seed: Seed, result: Match) -> bool:
        """Whether a match lies where dead reckoning may have it."""
        if np.isinf(self.config.max_innovation):
            return True
        innovation = (se2.compose(self._origin(), result.T_reference_scan) - seed.pose)[:2]
        distance = innovation @ np.linalg.solve(seed.covariance[:2, :2], innovation)
        return bool(distance <= self.config.max_innovation)

    def _calibrate(self, k: int) -> None:
        """Learn what a step between two matched scans tells about the INS."""
        steps, reckoning, j = self._steps, self.reckoning, self._last
        if j > 0 and steps.verdict[j] != Verdict.MATCHED:
            return
        sensed = reckoning.poses[k] - reckoning.poses[j]
        matched = steps.poses[k] - steps.poses[j]
        sigma = np.sqrt(np.abs(np.diag(steps.covariance[k])))
        self._calibration.learn(sensed, reckoning.seconds(j, k), matched, sigma)

    def _record_statistics(self, k: int, seed: Seed, scan: Scan, result: Match | NoMatch) -> None:
        """Keep the match's statistics; a step is expected from its reference on, whatever the seed."""
        steps, reckoning = self._steps, self.reckoning
        if isinstance(result, NoMatch):
            steps.statistics.note_failure(k)
            return
        expected, covariance = seed.pose, seed.covariance
        if self.config.seed_mode == "absolute":
            j = int(steps.reference[k])
            expected = reckoning.predict(j, k, steps.poses[j])
            covariance = reckoning.map_covariance(j, k, expected)
        attitude = None if self.measurements.attitude is None else self.measurements.attitude[k]
        steps.statistics.note(k, result, len(scan), attitude, self._origin(), expected, covariance)

    def _extend_map(self, k: int, scan: Scan, tilted: bool) -> None:
        """What scan k adds to what the next ones are matched against."""
        lost = self.reckoning.absent and k - self._last_matched >= self.config.laser_only.max_unmatched
        if lost and len(scan) > 0:
            self._start_anew(scan, k)
        elif self._is_keyframe(k) and (self.config.reference == "scan" or not tilted):
            self._add_keyframe(scan, k)

    def _start_anew(self, scan: Scan, k: int) -> None:
        """A robot that has been lost for long sees places it has no map of: forget the local map."""
        self._last_matched = k
        if self.config.reference == "local_map":
            self._local = LocalMap(self.config.map_scans)
        self._add_keyframe(scan, k)

    def _is_keyframe(self, k: int) -> bool:
        config, poses = self.config, self._steps.poses
        step = np.abs(se2.between(poses[self._keyframes[-1]], poses[k]))
        return bool(np.any(step >= [config.extend_distance, config.extend_distance, config.extend_angle]))

    def _add_keyframe(self, scan: Scan, k: int) -> None:
        """Scan k is matched against from now on, alone in its own frame, or with the last ones in the map
        frame."""
        self._keyframes.append(k)
        if self.config.reference == "scan":
            self._local = Reference(scan)
        else:
            assert isinstance(self._local, LocalMap)
            self._local.add(scan, self._steps.poses[k])

    def _origin(self) -> Array:
        """Pose in the map of the frame that scans are matched in."""
        scan_to_scan = self.config.reference == "scan"
        return self._steps.poses[self._keyframes[-1]] if scan_to_scan else np.zeros(3)


def _with_wide_search(config: FrontendConfig) -> FrontendConfig:
    """The settings for a robot that nothing but its laser tells how it moved: no scan is matched without a
    wide search for a better answer. A matcher that never searches stays as it is."""
    if config.match.search_shift <= 0.0:
        return config
    wide = config.laser_only
    shift, turn = wide.search_shift, wide.search_turn
    return replace(
        config, match=replace(config.match, search_shift=shift, search_turn=turn, least_share=ALWAYS)
    )
