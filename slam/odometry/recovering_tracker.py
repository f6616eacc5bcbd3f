"""The front end for dead reckoning that lies: what contradicts it is looked for as if there were none.

A step of dead reckoning is contradicted where the best match is one that it forbids, where it stands still
though the laser moved, and where a scan fits nowhere. Contradicted steps predict nothing, their covariance is
that of a robot that may have gone anywhere, and the scan after one is looked for as widely.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from slam import se2
from slam.matching import Match, NoMatch, match
from slam.matching.free_space import Sight
from slam.measurements import Measurements
from slam.odometry.recovery import Fit, RecoveryConfig, frozen_scans, saw_motion
from slam.odometry.tilt import tilted_scans
from slam.odometry.track import Track, Verdict
from slam.odometry.tracker import ALWAYS, FrontendConfig, Seed, Tracker
from slam.recording import Recording
from slam.scan import Scan
from slam.se2 import Array

FIT_START = 0.6
"""Fit of matches before there are any, and …"""
FIT_WINDOW = 100
"""… matches whose median it is then."""


def is_contradicted(recording: Recording, track: Track, config: RecoveryConfig) -> bool:
    """Whether what the laser saw contradicts dead reckoning more often than on any honest drive."""
    enough = max(config.min_contradictions, config.min_contradicted_share * len(track))
    contradicted = track.contradicted | frozen_scans(recording, config)
    return config.min_contradictions > 0 and int(np.count_nonzero(contradicted)) >= enough


def track_recovering(
    recording: Recording, config: FrontendConfig, recovery: RecoveryConfig, scans: Sequence[Scan]
) -> Track:
    """As `slam.odometry.tracker.track`, with dead reckoning doubted."""
    tilted = tilted_scans(recording, config.tilt_limit, config.tilt_window)
    tracker = RecoveringTracker(recording, config, recovery, room=len(recording))
    for scan, is_tilted in zip(scans, tilted, strict=True):
        tracker.step(scan, is_tilted)
    return tracker.track()


class RecoveringTracker(Tracker):
    """As `Tracker`, for a robot whose dead reckoning lies."""

    def __init__(
        self,
        measurements: Measurements,
        config: FrontendConfig,
        recovery: RecoveryConfig = RecoveryConfig(),
        room: int = 256,
    ) -> None:
        self.recovery = recovery
        super().__init__(measurements, config, room)
        self._sights: deque[Sight] = deque(maxlen=config.map_scans)
        self._fits = deque([FIT_START], maxlen=FIT_WINDOW)
        self._wide = replace(
            config.match,
            search_shift=recovery.search_shift,
            search_turn=recovery.search_turn,
            least_share=ALWAYS,
        )
        self._spacing = float(np.median(np.diff(measurements.angles)))

    def _predict(self, k: int) -> Seed:
        contradicted, j = self._steps.contradicted, self._last
        contradicted[k] = self._is_frozen(k)
        self.reckoning.contradicted = contradicted
        seed = super()._predict(k)
        pose = self._coasted(k) if contradicted[k] else seed.pose
        since = self._last_matched if contradicted[self._last_matched + 1 : j + 1].any() else j
        return Seed(pose, self.reckoning.map_covariance(since, k, pose))

    def _is_frozen(self, k: int) -> bool:
        """Whether dead reckoning stands still though the laser moved."""
        ranges, poses = self.measurements.ranges, self.reckoning.poses
        step = np.abs(se2.between(poses[self._last], poses[k]))
        return bool(np.all(step < self.recovery.still)) and saw_motion(
            ranges[self._last], ranges[k], self.recovery
        )

    def _coasted(self, k: int) -> Array:
        """Pose ``(3,)`` at scan k of a robot that goes on as it last went."""
        poses, j = self._steps.poses, self._last
        i = int(self._steps.reference[j])
        before, since = self.reckoning.seconds(i, j), self.reckoning.seconds(j, k)
        if i < 0 or before <= 0.0 or since <= 0.0:
            return poses[j]
        step = se2.log(se2.between(poses[i], poses[j]))
        return se2.compose(poses[j], se2.exp(step * min(since / before, 2.0)))

    def _match(self, scan: Scan, seed: Seed) -> Match | NoMatch:
        return super()._match(scan, Seed(seed.pose, seed.covariance * self.recovery.prior_inflation))

    def _judge(self, k: int, scan: Scan, seed: Seed, result: Match | NoMatch) -> tuple[Match | NoMatch, bool]:
        frozen, after_doubt = bool(self._steps.contradicted[k]), bool(self._steps.contradicted[self._last])
        fit = Fit(scan, self._origin(), self._sights, self._spacing, self.recovery)
        believed = self._is_sound(result) and self._agrees(seed, result) and not (frozen or after_doubt)
        if believed and isinstance(result, Match) and not fit.violates(result):
            self._fits.append(fit.of(result))
            return result, True
        guesses = seed.pose, self._steps.poses[self._last], self._coasted(k)
        answers = [result, *(self._match_anywhere(scan, guess) for guess in guesses)]
        best = fit.best(answers, self._least_fit(), seed.pose)
        if best is not None:
            self._steps.contradicted[k] = frozen or not self._agrees(seed, best)
            return best, True
        lost = not believed and len(scan) > self.recovery.min_points
        self._steps.contradicted[k] = frozen or lost
        return result, believed

    def _least_fit(self) -> float:
        return min(self.recovery.min_fit, float(np.median(self._fits)) - self.recovery.fit_tolerance)

    def _match_anywhere(self, scan: Scan, pose: Array) -> Match | NoMatch:
        """The scan matched without a prior, searched for around a ``pose (3,)``."""
        guess, config = se2.between(self._origin(), pose), self.config
        return match(self._local, scan, guess, config.method, config.covariance, config=self._wide)

    def _extend_map(self, k: int, scan: Scan, tilted: bool) -> None:
        steps = self._steps
        lost = steps.contradicted[k] and steps.verdict[k] == Verdict.FELL_BACK
        if not lost:
            super()._extend_map(k, scan, tilted)
        elif k - self._last_matched >= self.recovery.max_lost:
            self._start_anew(scan, k)

    def _add_keyframe(self, scan: Scan, k: int) -> None:
        super()._add_keyframe(scan, k)
        T_robot_laser = self.measurements.laser.T_robot_laser
        self._sights.append(Sight.of(scan, self._steps.poses[k], T_robot_laser))
