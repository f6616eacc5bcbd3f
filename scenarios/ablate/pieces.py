"""Submaps as a front end hands them over: stretches of a drive, drawn where it believed the robot was."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from slam import se2
from slam.mapping import keyframes, occupancy
from slam.mapping.submap import Submap, cut
from slam.odometry.segmentation import SegmentationConfig, segments
from slam.odometry.track import Track, Verdict
from slam.odometry.tracker import track
from slam.recording import Recording
from slam.scan import scans_of
from slam.se2 import Array

LENGTH = (30.0, 60.0)
"""Shortest and longest stretch [m], unless asked for others: submaps of about 30 × 20 m."""
PER_DRIVE = 14
"""Stretches cut from a drive."""
LOST = SegmentationConfig(rule="zero_run", run=10)
"""No stretch goes over this many scans in a row without a match."""
MOST_WARP = (0.15, np.radians(1.0))
"""A stretch bent by more (m, rad) is left out: two that are may differ by as much as a stitch may be wrong
by, and no answer need be right."""
CELL = 0.2
"""Side of the world's cells [m] in which overlap is counted."""


@dataclass(frozen=True)
class Piece:
    """A submap, and what only the simulator knows of it.

    ``known (n, 2)``: world cells of `CELL` m that its scans saw from their true poses; ``T_world_map
    (K, 3)``: where its K drawn scans say that its frame lies, all equal were the submap not bent; ``middles
    (K, 2)``: the middle of what each of them saw, in the world.
    """

    submap: Submap
    known: np.ndarray
    T_world_map: Array
    middles: Array


def pieces(
    recording: Recording, rng: np.random.Generator, length: tuple[float, float] = LENGTH
) -> tuple[list[Piece], int]:
    """Stretches of a drive as submaps, and how many are bent beyond `MOST_WARP` and left out.

    ``length``: of the shortest and of the longest [m]. Raises ``ValueError`` for a recording without truth.
    """
    if recording.truth is None:
        raise ValueError(f"{recording.name}: expected a recording with truth")
    scans = scans_of(recording)
    found = track(recording, scans=scans)
    drawn = np.array([k for k in keyframes.choose(found.poses) if found.verdict[k] != Verdict.FELL_BACK])
    kept, bent = [], 0
    for start, stop in stretches(found, rng, length):
        rows = drawn[(drawn >= start) & (drawn < stop)]
        if len(rows) == 0:
            continue
        T_map_robot = se2.between(found.poses[start], found.poses[rows])
        T_world_map = se2.compose(recording.truth[rows], se2.inverse(T_map_robot))
        if warp(T_world_map, recording.truth[rows, :2]) > 1.0:
            bent += 1
            continue
        submap = cut(recording, scans, found.poses, start, stop, rows)
        middles = _middles(recording, rows)
        kept.append(Piece(submap, _known(recording, rows), T_world_map, middles))
    return kept, bent


def stretches(found: Track, rng: np.random.Generator, length: tuple[float, float]) -> list[tuple[int, int]]:
    """Scans ``start..stop-1`` of stretches of a random length [m] between two, none over where the robot got
    lost."""
    shortest, longest = length
    chosen = []
    path = se2.path_length(found.poses)
    whole = [s for s in segments(found, LOST) if path[s.stop - 1] - path[s.start] >= shortest]
    if not whole:
        return []
    room = np.array([path[s.stop - 1] - path[s.start] - shortest for s in whole]) + 1.0
    for k in rng.choice(len(whole), PER_DRIVE, p=room / room.sum()):
        low, high = path[whole[k].start], path[whole[k].stop - 1]
        long = rng.uniform(shortest, min(longest, high - low))
        begin = rng.uniform(low, high - long)
        start, stop = np.searchsorted(path, [begin, begin + long])
        chosen.append((int(start), min(int(stop), whole[k].stop)))
    return chosen


def warp(T_world_map: Array, places: Array) -> float:
    """How far a submap is from rigid, in units of `MOST_WARP`: the worst of its scans."""
    drawn = se2.transform(se2.inverse(T_world_map), places[:, None])[:, 0]
    rigid = best_rigid(drawn, places)
    off = np.linalg.norm(se2.transform(rigid, drawn) - places, axis=1)
    turned = np.abs(se2.wrap(T_world_map[:, 2] - rigid[2]))
    return float(max(off.max() / MOST_WARP[0], turned.max() / MOST_WARP[1]))


def best_rigid(points: Array, targets: Array) -> Array:
    """The pose ``(3,)`` that brings points ``(n, 2)`` nearest to their targets (Umeyama 1991, no scale)."""
    p, q = points - points.mean(axis=0), targets - targets.mean(axis=0)
    yaw = float(np.arctan2(np.sum(p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0]), np.sum(p * q)))
    return np.array([*(targets.mean(axis=0) - se2.rotation(yaw) @ points.mean(axis=0)), yaw])


def _known(recording: Recording, rows: np.ndarray) -> np.ndarray:
    """World cells ``(n, 2)`` seen from the true poses of the scans ``rows``."""
    assert recording.truth is not None
    grid = occupancy.draw(
        recording.truth[rows], recording.ranges[rows], recording.angles, recording.laser, CELL
    )
    row, column = np.nonzero(grid.occupied | grid.free)
    first = np.round(grid.origin / CELL).astype(np.int64)
    return np.stack([column, row], -1) + first


def _middles(recording: Recording, rows: np.ndarray) -> Array:
    """Middle ``(K, 2)`` of what each scan hit, in the world; the robot itself where it hit nothing."""
    assert recording.truth is not None
    T_world_laser = se2.compose(recording.truth[rows], recording.laser.T_robot_laser)
    bearing = T_world_laser[:, 2:] + recording.angles
    r = recording.ranges[rows]
    seen = np.isfinite(r)
    r = np.where(seen, r, 0.0)
    count = np.maximum(seen.sum(axis=1), 1)
    shift = np.stack([(r * np.cos(bearing)).sum(axis=1), (r * np.sin(bearing)).sum(axis=1)], -1)
    return T_world_laser[:, :2] + shift / count[:, None]
