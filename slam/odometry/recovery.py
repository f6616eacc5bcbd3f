"""How a scan that contradicts dead reckoning is looked for without it, and when what is found is believed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from slam import se2
from slam.matching import Match, NoMatch
from slam.matching.free_space import Sight, violations
from slam.recording import Recording
from slam.scan import Scan
from slam.se2 import Array


@dataclass(frozen=True)
class RecoveryConfig:
    """Tracking a robot whose dead reckoning lies.

    A match *fits* as well as the share, of the points where the scans of the local map looked, that it pairs,
    less `violation_loss` times the share that lies in space which those scans saw free, less `misfit_loss`
    times its mean misfit (χ²).
    """

    min_contradictions: int = 3
    """Matches that contradict dead reckoning, and steps that it does not see though the laser moved, from
    which the drive is tracked anew; 0: never …"""
    min_contradicted_share: float = 0.0025
    """… where they are more than this share of the scans: on honest logs there is at most one."""
    prior_inflation: float = 25.0
    """Covariance inflation of dead reckoning's prior in a match: where walls decide, they shall."""
    search_shift: float = 1.5
    """How far [m] around each guess a match is looked for."""
    search_turn: float = np.radians(60.0)
    """How far [rad] around each guess a match is looked for."""
    max_violations: float = 0.12
    """Share of points in free space above which a match is looked for elsewhere."""
    violation_loss: float = 2.0
    """What a share of points in free space takes from a match's fit."""
    misfit_loss: float = 0.1
    """What a mean misfit (χ²) takes from a match's fit."""
    min_fit: float = 0.12
    """A match found without dead reckoning is believed from this fit on …"""
    fit_tolerance: float = 0.4
    """… or where the drive's matches fit badly, if it fits at most so much worse than their median."""
    equal_share: float = 0.97
    """Share of the most pairs from which an answer is as good: of these the expected one is taken."""
    margin: float = 0.3
    """Metres that a point lies before a wall at least to be in free space."""
    gap: float = 1.5
    """Largest gap, in spacings of the beams, across which a scan is said to have looked."""
    min_points: int = 40
    """Points of a scan that is taken for lost where it fits nowhere: with fewer there is little to see."""
    max_lost: int = 3
    """Lost scans after which a new local map begins."""
    still: float = 1e-4
    """Step [m or rad] below which dead reckoning stands still …"""
    changed_share: float = 0.15
    """… though the laser moved, if more than this share of the beams that returned from both places …"""
    changed_range: float = 0.1
    """… did so from ranges that differ by more [m] …"""
    min_beams: int = 20
    """… and so many returned from both."""


def saw_motion(before: Array, after: Array, config: RecoveryConfig) -> bool:
    """Whether ``ranges (B,)`` m of two scans differ as they do when the laser moves."""
    both = np.isfinite(before) & np.isfinite(after)
    changed = np.abs(before[both] - after[both]) > config.changed_range
    return len(changed) >= config.min_beams and float(np.mean(changed)) > config.changed_share


def frozen_scans(recording: Recording, config: RecoveryConfig) -> np.ndarray:
    """Scans ``(N,)`` bool since the last of which dead reckoning stood still though the laser moved."""
    steps = np.abs(se2.between(recording.dead_reckoning[:-1], recording.dead_reckoning[1:]))
    frozen = np.zeros(len(recording), dtype=bool)
    for k in np.flatnonzero(np.all(steps < config.still, axis=1)) + 1:
        frozen[k] = saw_motion(recording.ranges[k - 1], recording.ranges[k], config)
    return frozen


@dataclass(frozen=True)
class Fit:
    """How poses of a ``scan`` fit what the ``sights`` of the local map saw.

    ``origin (3,)`` is the pose in the map of the frame that matches are given in; ``spacing`` rad is that of
    the beams.
    """

    scan: Scan
    origin: Array
    sights: Sequence[Sight]
    spacing: float
    config: RecoveryConfig

    def violates(self, match: Match) -> bool:
        """Whether too many points lie in space that was seen free."""
        looked, violated = self._violations(match)
        return violated > self.config.max_violations * looked

    def of(self, match: Match) -> float:
        """Paired share, less violations and misfit."""
        looked, violated = self._violations(match)
        paired = (match.n_matches - self.config.violation_loss * violated) / max(looked, 1)
        return paired - self.config.misfit_loss * match.misfit

    def best(self, answers: Sequence[Match | NoMatch], least: float, expected: Array) -> Match | None:
        """Of the answers that fit by ``least``, that with the most pairs; of equals that nearest to the
        ``expected`` pose ``(3,)`` in the map; or nothing."""
        matches = (answer for answer in answers if isinstance(answer, Match) and answer.converged)
        good = [match for match in matches if self.of(match) >= least]
        most = max((match.n_matches for match in good), default=0)
        equals = (match for match in good if match.n_matches >= self.config.equal_share * most)
        guess = se2.between(self.origin, expected)[:2]
        return min(equals, key=lambda m: np.linalg.norm(m.T_reference_scan[:2] - guess), default=None)

    def _violations(self, match: Match) -> tuple[int, int]:
        points = se2.transform(se2.compose(self.origin, match.T_reference_scan), self.scan.points)
        return violations(self.sights, points, self.config.gap * self.spacing, self.config.margin)
