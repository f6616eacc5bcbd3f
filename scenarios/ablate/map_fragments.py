"""Fragments of the map of a drive: submaps drawn at the poses that the front end estimated."""

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
"""Shortest and longest distance driven for a fragment [m]: submaps of about 30 × 20 m."""
PER_DRIVE = 14
"""Fragments drawn from a drive."""
LOST = SegmentationConfig(rule="zero_run", run=10)
"""A fragment does not span this many scans in a row without a match."""
MOST_WARP = (0.15, np.radians(1.0))
"""Largest deformation (m, rad) of a fragment that is kept: beyond, no alignment of two need be correct."""
CELL = 0.2
"""Side of the world cells [m] in which overlap is counted."""


@dataclass(frozen=True)
class MapFragment:
    """A submap with its ground truth.

    ``known (n, 2)``: indices of the world cells of `CELL` m that its scans saw from their true poses;
    ``T_world_map (K, 3)``: the pose of its frame by each of its K scans, all equal where it is not bent;
    ``middles (K, 2)`` m: centroid of each scan's points in the world.
    """

    submap: Submap
    known: np.ndarray
    T_world_map: Array
    middles: Array


def cut_fragments(
    recording: Recording, rng: np.random.Generator, length: tuple[float, float] = LENGTH
) -> tuple[list[MapFragment], int]:
    """Random fragments of a drive, and how many were left out as bent beyond `MOST_WARP`; ``length``: [m] of
    drive for the shortest and the longest. Raises ``ValueError`` for a recording without truth."""
    if recording.truth is None:
        raise ValueError(f"{recording.name}: expected a recording with truth")
    scans = scans_of(recording)
    tracked = track(recording, scans=scans)
    drawn = np.array([k for k in keyframes.choose(tracked.poses) if tracked.verdict[k] != Verdict.FELL_BACK])
    kept, bent = [], 0
    for start, stop in draw_spans(tracked, rng, length):
        rows = drawn[(drawn >= start) & (drawn < stop)]
        if len(rows) == 0:
            continue
        T_map_robot = se2.between(tracked.poses[start], tracked.poses[rows])
        T_world_map = se2.compose(recording.truth[rows], se2.inverse(T_map_robot))
        if warp(T_world_map, recording.truth[rows, :2]) > 1.0:
            bent += 1
            continue
        submap = cut(recording, scans, tracked.poses, start, stop, rows)
        middles = _middles(recording, rows)
        kept.append(MapFragment(submap, _known(recording, rows), T_world_map, middles))
    return kept, bent


def draw_spans(
    tracked: Track, rng: np.random.Generator, length: tuple[float, float]
) -> list[tuple[int, int]]:
    """Scans ``start..stop-1`` of random spans of a ``length`` [m] between two, none across a lost stretch."""
    shortest, longest = length
    chosen = []
    path = se2.path_length(tracked.poses)
    whole = [s for s in segments(tracked, LOST) if path[s.stop - 1] - path[s.start] >= shortest]
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
    """Deformation of a submap in units of `MOST_WARP`: the largest deviation of ``T_world_map (K, 3)`` at the
    ``places (K, 2)`` m of its scans from a rigid map."""
    drawn = se2.transform(se2.inverse(T_world_map), places[:, None])[:, 0]
    rigid = se2.fit_rigid(drawn, places)
    off = np.linalg.norm(se2.transform(rigid, drawn) - places, axis=1)
    turned = np.abs(se2.wrap(T_world_map[:, 2] - rigid[2]))
    return float(max(off.max() / MOST_WARP[0], turned.max() / MOST_WARP[1]))


def _known(recording: Recording, rows: np.ndarray) -> np.ndarray:
    """Indices ``(n, 2)`` of the world cells seen from the true poses of the scans ``rows``."""
    assert recording.truth is not None
    grid = occupancy.draw(
        recording.truth[rows], recording.ranges[rows], recording.angles, recording.laser, CELL
    )
    row, column = np.nonzero(grid.occupied | grid.free)
    first = np.round(grid.origin / CELL).astype(np.int64)
    return np.stack([column, row], -1) + first


def _middles(recording: Recording, rows: np.ndarray) -> Array:
    """Centroid ``(K, 2)`` m of each scan's points in the world; the laser where there are none."""
    assert recording.truth is not None
    T_world_laser = se2.compose(recording.truth[rows], recording.laser.T_robot_laser)
    bearing = T_world_laser[:, 2:] + recording.angles
    r = recording.ranges[rows]
    seen = np.isfinite(r)
    r = np.where(seen, r, 0.0)
    count = np.maximum(seen.sum(axis=1), 1)
    shift = np.stack([(r * np.cos(bearing)).sum(axis=1), (r * np.sin(bearing)).sum(axis=1)], -1)
    return T_world_laser[:, :2] + shift / count[:, None]
