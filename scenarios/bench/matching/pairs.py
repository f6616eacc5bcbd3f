"""Pairs of scans whose relative pose is known, by simulation or from a log, and guesses to start from."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

import numpy as np

from scenarios.bench.building import SEGMENTS, building, free_poses
from sim.laser import Raycaster
from slam import se2
from slam.formats import FormatError, load
from slam.formats.peer import read as read_poses
from slam.recording import Laser, Recording
from slam.scan import Scan
from slam.se2 import Array

ANGLES = np.radians(np.arange(-90.0, 91.0))
LASER = Laser(range_min=0.1, range_max=20.0, sigma_range=0.01)
"""The simulated laser: 181 beams over 180°."""
APART = np.array([0.2, 0.2, np.radians(10.0)])
"""Largest distance [m, m, rad] of the second simulated pose from the first, along each axis."""
CLEARANCE = 0.2
"""Room [m] there must be beyond the second simulated pose, seen from the first."""

INTEL = Path("carmen") / "intel.raw.log.gz"
INTEL_POSES = Path("carmen") / "intel.gmapping_ref.txt"
EXPERIMENT_1 = Path("usarsim") / "iro2012-pre2" / "Robot1.log"
UPRIGHT = np.radians(5.0)
"""Most roll and pitch [rad] the INS may show in a scan of Experiment 1."""
QUANTUM = 0.01
"""Step [m, rad] to which the truth of Experiment 1 is rounded."""

GMAPPING_SIGMA = np.array([0.019, 0.019, np.radians(0.45)])
"""Robust standard deviation [m, m, rad] of GMapping's step from scan to scan, by a three-cornered hat: it
differs from small_gicp's GICP by (0.020, 0.019, 0.46°) and from ours by (0.018, 0.019, 0.45°), while the two
differ from each other by (0.003, 0.004, 0.11°)."""

EASY, HARD = (0.2, np.radians(10.0)), (0.5, np.radians(25.0))
"""How far [m, rad] a guess is off, at most, along each axis."""


@dataclass(frozen=True)
class Pair:
    """Two scans of one laser and where the second is, seen from the first.

    ``ranges (2, B)`` m and ``angles (B,)`` rad; ``T_reference_scan (3,)``; ``truth_covariance (3, 3)`` of
    that pose itself in the body frame of the scan, zero where it is exact; ``poses (2, 3)`` of the robot.
    """

    ranges: Array
    angles: Array
    laser: Laser
    poses: Array
    truth_covariance: Array = field(default_factory=lambda: np.zeros((3, 3)))

    @cached_property
    def T_reference_scan(self) -> Array:
        """True pose ``(3,)`` of the second scan in the frame of the first."""
        return se2.between(self.poses[0], self.poses[1])

    @cached_property
    def scans(self) -> tuple[Scan, Scan]:
        """Reference and scan."""
        first, second = (Scan.from_ranges(ranges, self.angles, self.laser) for ranges in self.ranges)
        return first, second


@dataclass(frozen=True)
class PairSet:
    """Pairs of one origin; ``walls (S, 4)`` m of the world they were seen in, where it is known."""

    name: str
    pairs: tuple[Pair, ...]
    note: str
    walls: Array | None = None

    def __len__(self) -> int:
        return len(self.pairs)


def simulated(count: int, rng: np.random.Generator) -> PairSet:
    """Pairs in the building of `SEGMENTS` walls, the second pose within `APART` of the first and in sight."""
    walls = building(SEGMENTS, rng)
    caster = Raycaster.from_segments(walls)
    first = free_poses(walls, count, rng)
    second = np.array([near(caster, pose, rng) for pose in first])
    pairs = tuple(look(caster, np.stack(poses), rng) for poses in zip(first, second, strict=True))
    return PairSet("simulated", pairs, "second pose within 0.2 m along each axis, 10°; exact truth", walls)


def intel(data: Path, count: int) -> PairSet | str:
    """Consecutive scans of the Intel log, spread over it, against GMapping's published answer, uncertain by
    `GMAPPING_SIGMA` (3 % of the matches started from it leave the limits); or why not."""
    if absent := _absent(data, INTEL, INTEL_POSES):
        return absent
    recording = load(data / INTEL)
    poses, uncertain = read_poses(data / INTEL_POSES, len(recording)), np.diag(GMAPPING_SIGMA**2)
    rows = spread(np.arange(1, len(recording)), count)
    pairs = tuple(_logged(recording, poses, row, uncertain) for row in rows)
    return PairSet("Intel", pairs, "every scan with the one before; truth is GMapping's, ± 19 mm, 0.45°")


def experiment_1(data: Path, count: int, moving: bool = False) -> PairSet | str:
    """Consecutive upright scans of the thesis's Experiment 1, spread over the log, all or those with the
    robot ``moving``, against its truth, whose rounding its covariance says; or why not. Upright is what
    the INS says, so that nothing after the fall counts. Raises `FormatError` without truth or attitude."""
    if absent := _absent(data, EXPERIMENT_1):
        return absent
    recording = load(data / EXPERIMENT_1)
    if recording.truth is None or recording.attitude is None:
        raise FormatError(
            "expected a log with the robot's true poses, and roll and pitch", data / EXPERIMENT_1
        )
    upright = np.all(np.abs(recording.attitude) < UPRIGHT, axis=1)
    steps = se2.between(recording.truth[:-1], recording.truth[1:])
    moved = np.any(np.abs(steps) > 0.1 * QUANTUM, axis=1)
    rows = 1 + np.flatnonzero(upright[1:] & upright[:-1] & (moved | (not moving)))
    uncertain = of_rounding(steps, QUANTUM)
    pairs = tuple(_logged(recording, recording.truth, row, uncertain[row - 1]) for row in spread(rows, count))
    name, kind = ("Exp. 1, moving", "upright and moving") if moving else ("Exp. 1", "upright")
    return PairSet(name, pairs, f"every scan with the one before, {kind}; truth in steps of 0.01")


def guesses(pairs: Sequence[Pair], off: tuple[float, float], rng: np.random.Generator) -> Array:
    """A guess ``(N, 3)`` for each pair: the truth plus uniform errors up to ``off`` (m, rad) on each axis."""
    distance, angle = off
    truth = np.array([pair.T_reference_scan for pair in pairs])
    return truth + rng.uniform(-1.0, 1.0, truth.shape) * [distance, distance, angle]


def of_rounding(T: Array, quantum: float) -> Array:
    """Covariance ``(..., 3, 3)`` of steps ``T (..., 3)`` between poses that were rounded to ``quantum``."""
    rounding = np.eye(3) * quantum**2 / 12.0
    return se2.compose_covariance(rounding, T, rounding)


def spread(rows: np.ndarray, count: int) -> np.ndarray:
    """At most ``count`` of the rows, evenly spread, first and last among them."""
    if len(rows) <= count:
        return rows
    return rows[np.linspace(0, len(rows) - 1, count).astype(int)]


def _absent(data: Path, *names: Path) -> str:
    missing = next((data / name for name in names if not (data / name).is_file()), None)
    return "" if missing is None else f"{missing} is not there (--data names the folder)"


def near(caster: Raycaster, pose: Array, rng: np.random.Generator) -> Array:
    """A pose near another and in its sight."""
    while True:
        other = se2.compose(pose, rng.uniform(-APART, APART))
        dx, dy = other[:2] - pose[:2]
        sight = caster.cast(np.array([[pose[0], pose[1], np.arctan2(dy, dx)]]), np.zeros(1))[0, 0]
        if sight > np.hypot(dx, dy) + CLEARANCE:
            return other


def look(caster: Raycaster, poses: Array, rng: np.random.Generator) -> Pair:
    """What the simulated laser sees from two poses."""
    ranges = caster.cast(poses, ANGLES)
    ranges += rng.normal(0.0, LASER.sigma_range, ranges.shape)
    ranges[(ranges > LASER.range_max) | (ranges < LASER.range_min)] = np.nan
    return Pair(ranges, ANGLES, LASER, poses)


def _logged(recording: Recording, poses: Array, row: int, uncertain: Array) -> Pair:
    """A scan of a log and the one before; ``uncertain (3, 3)`` is the covariance of the step of ``poses``."""
    last = slice(row - 1, row + 1)
    return Pair(recording.ranges[last], recording.angles, recording.laser, poses[last], uncertain)
