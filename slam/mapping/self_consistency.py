"""Does a map agree with itself? Told without truth, from where its scans contradict each other.

Scans that saw one place in different passes of the drive are laid onto each other where the map has them. In
a map that is right both see the same walls; in a torn one, one looks through the other's walls, or sees them
again beside themselves. Scans that follow each other tell where the drive itself was broken. What only one
pass ever saw cannot contradict anything: a drive that never comes back has no figure.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from slam import se2
from slam.mapping import keyframes
from slam.mapping.keyframes import KeyframeConfig
from slam.odometry.tilt import tilted_scans
from slam.recording import Recording
from slam.scan import scans_of
from slam.se2 import Array

FEW_BEAMS = "a scan has too few beams to contradict another"
NO_REVISIT = "the drive comes back to no place that it has seen before: nothing can contradict it"


@dataclass(frozen=True)
class SelfConsistencyConfig:
    """Which scans are laid onto each other, and what counts as a contradiction."""

    spacing: float = 0.5
    """A scan is compared if it was taken this far [m] from the last one that is …"""
    spacing_angle: float = np.radians(30.0)
    """… or turned by this [rad]."""
    most_scans: int = 600
    """Most scans that are compared: of a longer drive every second, third … of them."""
    most_beams: int = 180
    """Most points of a scan that are compared: of more beams every second, third …"""
    max_tilt: float = np.radians(3.0)
    """A scan that leans by more [rad] off the median of its neighbours sees the floor, and is left out."""
    radius: float = 4.0
    """Two passes saw one place if they came as near as this [m] …"""
    least_detour: float = 4.0
    """… and if more was driven between them than this [m] …"""
    detour_factor: float = 3.0
    """… and so many times their distance."""
    partners: int = 4
    """Scans of other passes that each is compared with, the nearest."""
    apart: float = 2.0
    """Path [m] between two of them."""
    tolerance: float = 0.15
    """A wall is looked through from this far [m] before what is seen there …"""
    tolerance_slope: float = 0.02
    """… and this times its range [m/m]."""
    half_width: float = 0.15
    """Half the width [m] of what has to lie behind a wall that is looked through."""
    gate: float = 0.6
    """Walls farther apart [m] are not taken for each other."""
    sigma_wall: float = 0.05
    """Standard deviation [m] of the distance of a wall in one scan from the same in another …"""
    sigma_shift: float = 0.3
    """… and of the shift [m] between two scans, which counts where too little is seen …"""
    sigma_turn: float = 0.1
    """… and of the turn [rad]."""
    noise_factor: float = 2.0
    """Shifts below this many standard deviations, as the scatter of the points tells them, are none."""
    least_met: int = 15
    """Points that must meet for two scans to be compared."""
    least_pairs: int = 10
    """Pairs of scans from different passes that it takes for a figure."""
    quantile_revisits: float = 0.9
    """What counts of the shifts and of the shares looked through between passes …"""
    quantile_neighbours: float = 0.995
    """… and of the shifts between scans that follow each other: a drive breaks in few places."""
    torn_shift: float = 0.1
    """A shift [m] between passes at which half of the figure is gone …"""
    torn_share: float = 0.3
    """… a share of walls looked through …"""
    torn_jump: float = 0.3
    """… a shift [m] of scans that follow each other."""
    place_shift: float = 0.15
    """A pair contradicts itself from this shift [m] …"""
    place_share: float = 0.4
    """… or share of walls looked through …"""
    place_size: float = 3.0
    """… and is of one place with others within this [m] …"""
    least_in_place: int = 2
    """… of which it takes so many."""


@dataclass(frozen=True)
class Contradiction:
    """A place ``x, y`` [m] where the map contradicts itself.

    The ``scans`` whose contradiction is worst there (rows, earlier and later) with the ``time`` [s] of the
    later, the number of ``pairs`` of scans that say so, and why.
    """

    x: float
    y: float
    scans: tuple[int, int]
    time: float
    pairs: int
    reason: str


@dataclass(frozen=True)
class SelfConsistency:
    """0 torn … 1 agrees with itself; None where nothing can tell, and the ``reason``.

    The parts: ``shift`` [m] and ``share`` of walls looked through between ``revisits`` pairs of scans of
    different passes, ``jump`` [m] between scans that follow each other; ``places``, those where the drive
    broke first.
    """

    figure: float | None
    reason: str
    shift: float = 0.0
    share: float = 0.0
    jump: float = 0.0
    revisits: int = 0
    places: tuple[Contradiction, ...] = ()

    @property
    def torn(self) -> bool:
        """Whether the map is more likely torn than not."""
        return self.figure is not None and self.figure < 0.5


@dataclass(frozen=True)
class Pairs:
    """Comparisons of scans: ``rows (P, 2)``, later and earlier; the ``shift (P,)`` [m] between them and the
    ``share (P,)`` of walls looked through, NaN where too little met; whether they are ``revisits (P,)``."""

    rows: np.ndarray
    shift: Array
    share: Array
    revisits: np.ndarray


def self_consistency(
    recording: Recording, poses: Array, config: SelfConsistencyConfig = SelfConsistencyConfig()
) -> SelfConsistency:
    """How far the map of a recording's scans at robot ``poses (N, 3)`` agrees with itself. Raises
    ``ValueError`` for poses of another shape."""
    if poses.shape != (len(recording), 3):
        raise ValueError(f"poses: expected ({len(recording)}, 3), got {poses.shape}")
    if len(recording.angles) < config.least_met:
        return SelfConsistency(None, FEW_BEAMS)
    return judge(compare(recording, poses, config), recording.time, poses, config)


def judge(pairs: Pairs, time: Array, poses: Array, config: SelfConsistencyConfig) -> SelfConsistency:
    """What the comparisons of scans at ``poses (N, 3)`` come to."""
    again = pairs.revisits
    shift = _quantile(pairs.shift[again], config.quantile_revisits)
    share = _quantile(pairs.share[again], config.quantile_revisits)
    jump = _quantile(pairs.shift[~again], config.quantile_neighbours)
    revisits = int(np.sum(np.isfinite(pairs.share[again])))
    doubt = shift / config.torn_shift + share / config.torn_share + jump / config.torn_jump
    places = contradictions(pairs, time, poses, config)
    told = revisits >= config.least_pairs or doubt > 1.0  # too few pairs can contradict, but not agree
    figure, reason = (float(2.0**-doubt), "") if told else (None, NO_REVISIT)
    return SelfConsistency(figure, reason, shift, share, jump, revisits, places)


def _quantile(values: Array, q: float) -> float:
    known = values[np.isfinite(values)]
    return float(np.quantile(known, q)) if len(known) else 0.0


def compare(recording: Recording, poses: Array, config: SelfConsistencyConfig) -> Pairs:
    """Scans of different passes, and scans that follow each other, laid onto each other."""
    from slam.mapping.scan_agreement import choose_partners, compare_pairs

    rows = chosen_scans(recording, poses, config)
    path = se2.path_length(poses)[rows]
    detour = np.array([config.least_detour, config.detour_factor])
    far = choose_partners(poses[rows], path, config.partners, config.radius, detour, config.apart)
    k = np.arange(len(rows))
    near = [np.column_stack([k[gap:], k[:-gap]]) for gap in (1, 2, 4)]
    pairs = np.concatenate([far, *near])
    revisits = np.arange(len(pairs)) < len(far)
    shift, expected, met, agreeing, through = compare_pairs(
        pairs,
        revisits,
        se2.compose(poses[rows], recording.laser.T_robot_laser),
        beams_of(recording, rows),
        recording.angles,
        -(-len(recording.angles) // config.most_beams),
        (config.tolerance, config.tolerance_slope, config.half_width),
        config.gate,
        np.array([config.sigma_wall, config.sigma_shift, config.sigma_turn]),
    ).T
    excess = np.sqrt(np.maximum(shift**2 - (config.noise_factor * expected) ** 2, 0.0))
    total = agreeing + through
    return Pairs(
        rows[pairs],
        np.where(met >= config.least_met, excess, np.nan),
        np.where(total >= config.least_met, through / np.maximum(total, 1.0), np.nan),
        revisits,
    )


def chosen_scans(recording: Recording, poses: Array, config: SelfConsistencyConfig) -> np.ndarray:
    """Rows ``(K,)`` of the scans that are compared: level ones, as many as the path needs."""
    level = np.flatnonzero(~tilted_scans(recording, config.max_tilt))
    if len(level) < 2:
        level = np.arange(len(recording))
    spacing = KeyframeConfig(config.spacing, config.spacing_angle)
    rows = level[keyframes.choose(poses[level], spacing)]
    return rows[:: -(-len(rows) // config.most_scans)]


def beams_of(recording: Recording, rows: np.ndarray) -> Array:
    """Ranges, points and normals ``(K, B, 5)`` of the scans ``rows (K,)`` in the laser's frame, NaN for
    none."""
    laser = recording.laser
    kept = np.isin(np.arange(len(recording)), rows)
    seen = (recording.ranges >= laser.range_min) & (recording.ranges < laser.range_max)
    alone = replace(
        recording.with_scans(kept),
        ranges=np.where(seen, recording.ranges, np.nan)[kept],
        laser=replace(laser, T_robot_laser=np.zeros(3)),
    )
    beams = np.full((len(rows), len(recording.angles), 5), np.nan)
    beams[..., 0] = alone.ranges
    for k, scan in enumerate(scans_of(alone)):
        beams[k, scan.beams, 1:3], beams[k, scan.beams, 3:] = scan.points, scan.normals
    return beams


def contradictions(
    pairs: Pairs, time: Array, poses: Array, config: SelfConsistencyConfig
) -> tuple[Contradiction, ...]:
    """The places at which pairs contradict themselves: where the drive broke, then where passes meet that do
    not fit; of either the one with most pairs first."""
    shift, share = np.nan_to_num(pairs.shift), np.nan_to_num(pairs.share) * pairs.revisits
    strength = np.maximum(shift / config.place_shift, share / config.place_share)
    bad = np.flatnonzero(strength >= 1.0)
    bad = bad[np.argsort(-strength[bad], kind="stable")]
    middle = poses[pairs.rows[bad]][..., :2].mean(axis=1)
    again = pairs.revisits[bad]
    places = []
    left = np.ones(len(bad), dtype=bool)
    for k in range(len(bad)):
        if not left[k]:
            continue
        apart = np.hypot(*(middle - middle[k]).T)
        here = left & (again == again[k]) & (apart <= config.place_size)
        left &= ~here
        if here.sum() >= config.least_in_place:
            later, earlier = (int(row) for row in pairs.rows[bad[k]])
            reason = _reason(shift[bad[k]], share[bad[k]], bool(again[k]), config)
            x, y = middle[k].tolist()
            places.append(
                (
                    bool(again[k]),
                    -int(here.sum()),
                    Contradiction(x, y, (earlier, later), float(time[later]), int(here.sum()), reason),
                )
            )
    return tuple(place for *_, place in sorted(places, key=lambda entry: entry[:2]))


def _reason(shift: float, share: float, revisit: bool, config: SelfConsistencyConfig) -> str:
    if not revisit:
        return f"scans that follow each other lie {shift:.2f} m apart"
    if share >= config.place_share:
        return f"one pass looks through {share:.0%} of the walls that another saw"
    return f"walls seen again {shift:.2f} m beside themselves"
