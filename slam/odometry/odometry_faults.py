"""What is wrong with an odometry throughout a drive, as its matches tell: it lags, or has lost its sign."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from slam import se2
from slam.odometry.track import Track, Verdict
from slam.recording import Recording
from slam.se2 import Array


@dataclass(frozen=True)
class OdometryFaultConfig:
    """When the odometry of a drive on which matches contradict it is corrected."""

    max_delay: int = 5
    """Most scans that odometry is looked for before or after its own; 0: a delay is not looked for."""
    delay_gain: float = 0.7
    """Disagreement with the matches, as a share of that without a delay, at which a delay is believed."""
    metre: float = 1.0
    """Radians that a metre of disagreement counts for."""
    cap: float = 0.3
    """Largest disagreement [rad] of a step that counts: more is a false match."""
    min_backwards: int = 3
    """Steps of an odometry that knows one way only which matches see the other way round, from which its sign
    is believed to be lost; 0: never."""
    max_backwards: float = 0.5
    """Share of the steps seen the other way round above which it is the laser that is mounted so."""
    sign_tolerance: float = 0.3
    """Share of a step's length by which it may differ from one the other way round."""
    least_step: float = 0.03
    """Metres of a step whose direction counts."""


@dataclass(frozen=True)
class OdometryFaults:
    """``delay`` in scans (positive: late) and whether the sign of driving backwards is lost, with the steps
    ``backwards (N - 1,)`` bool that the matches see so."""

    delay: int
    backwards: np.ndarray

    def __bool__(self) -> bool:
        return self.delay != 0 or bool(self.backwards.any())

    def __str__(self) -> str:
        parts = []
        if self.delay:
            scans = "1 scan" if abs(self.delay) == 1 else f"{abs(self.delay)} scans"
            parts.append(f"{scans} {'late' if self.delay > 0 else 'early'}")
        if self.backwards.any():
            parts.append(f"without sign ({np.count_nonzero(self.backwards)} steps backwards)")
        return " and ".join(parts) or "as recorded"

    def corrected(self, recording: Recording) -> Recording:
        """The recording with dead reckoning moved by the delay and turned round where it drove backwards;
        where there is none left at an end, it stands still."""
        steps = _shifted(_steps(recording.dead_reckoning), self.delay)
        steps[self.backwards, :2] *= -1.0
        poses = [recording.dead_reckoning[0]]
        for step in steps:
            poses.append(se2.compose(poses[-1], step))
        return replace(recording, dead_reckoning=np.array(poses))


def find_faults(
    recording: Recording, track: Track, config: OdometryFaultConfig = OdometryFaultConfig()
) -> OdometryFaults:
    """What makes the odometry agree better with the matched steps of a ``track`` of the recording."""
    seen, told = _steps(track.poses), _steps(recording.dead_reckoning)
    matched = track.verdict == Verdict.MATCHED
    both = matched[1:] & matched[:-1]
    delay = _delay(seen, told, both, config)
    told = _shifted(told, delay)
    return OdometryFaults(delay, _backwards(seen, told, both, config))


def _steps(poses: Array) -> Array:
    """Steps ``(N - 1, 3)`` between poses ``(N, 3)``, each in the body frame of the earlier."""
    return se2.between(poses[:-1], poses[1:])


def _shifted(steps: Array, delay: int) -> Array:
    """What was told ``delay`` scans late, at its own; zero where nothing was told."""
    shifted = np.zeros_like(steps)
    if delay >= 0:
        shifted[: len(steps) - delay] = steps[delay:]
    else:
        shifted[-delay:] = steps[:delay]
    return shifted


def _delay(seen: Array, told: Array, both: np.ndarray, config: OdometryFaultConfig) -> int:
    """Scans by which ``told`` must be late for the steps to agree best; 0 where that is not much better."""
    delays = sorted(range(-config.max_delay, config.max_delay + 1), key=abs)
    apart = [_disagreement(seen[both], _shifted(told, delay)[both], config) for delay in delays]
    best = int(np.argmin(apart))
    return delays[best] if apart[best] < config.delay_gain * apart[0] else 0


def _disagreement(seen: Array, told: Array, config: OdometryFaultConfig) -> float:
    if len(seen) == 0:
        return 0.0
    turn = np.abs(se2.wrap(seen[:, 2] - told[:, 2]))
    way = np.abs(np.hypot(seen[:, 0], seen[:, 1]) - np.hypot(told[:, 0], told[:, 1]))
    return float(np.mean(np.minimum(turn + config.metre * way, config.cap)))


def _backwards(seen: Array, told: Array, both: np.ndarray, config: OdometryFaultConfig) -> np.ndarray:
    """Steps ``(N - 1,)`` bool driven the other way round than an odometry tells that knows one way only."""
    long = both & (np.abs(told[:, 0]) > config.least_step)
    turned = np.abs(seen[:, 0] + told[:, 0]) < config.sign_tolerance * np.abs(told[:, 0])
    opposed = long & turned
    one_way = np.all(told[:, 0] > -config.least_step) or np.all(told[:, 0] < config.least_step)
    count = np.count_nonzero(opposed)
    lost = one_way and 0 < config.min_backwards <= count < config.max_backwards * np.count_nonzero(long)
    return opposed if lost else np.zeros(len(told), dtype=bool)
