"""Two recordings of one building, and fragments of the maps that the front end makes of them.

The second drive goes back, and furniture may have been moved in between.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from scenarios.ablate.trial_io import stream
from scenarios.catalogue.building import start as start_of
from sim.driver import resample
from sim.floorplan import Prism
from sim.record import Buildable, Setup, SimulatedRun, drive, observe
from slam import se2
from slam.mapping import keyframes, occupancy
from slam.mapping.submap import Submap, cut
from slam.odometry.segmentation import SegmentationConfig, segments
from slam.odometry.track import Track, Verdict
from slam.odometry.tracker import track
from slam.recording import Recording
from slam.scan import scans_of
from slam.se2 import Array

SHARE_MOVED = 0.5
"""Share of the furniture that is moved."""
LARGEST = 2.5
"""Furniture larger than this [m] stays."""
FARTHEST = 1.5
"""Largest displacement on each axis [m]."""
CLEARANCE = 0.45
"""Least distance of moved furniture from the route [m]."""
TRIES = 12
"""Random places that are tried for a piece before it is removed."""
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


def record_two_sessions(scenario: Buildable, seed: int, moved: bool) -> tuple[SimulatedRun, SimulatedRun]:
    """A drive through a scenario, and one back along its route; between them furniture may be ``moved``."""
    rng = stream(seed, scenario.name, "sessions")
    building, moving, *streams = rng.spawn(8)
    first = scenario.build(building)
    prisms = rearrange(first.world.prisms, resample(first.waypoints), moving) if moved else first.world.prisms
    route = first.waypoints[::-1]
    second = replace(first, world=replace(first.world, prisms=prisms), waypoints=route, start=start_of(route))
    return _record(scenario.name, first, streams[:3]), _record(scenario.name, second, streams[3:])


def _record(name: str, setup: Setup, streams: Sequence[np.random.Generator]) -> SimulatedRun:
    driving, scanning, reckoning = streams
    return observe(name, setup, drive(setup, driving), scanning, reckoning)


def rearrange(prisms: tuple[Prism, ...], route: Array, rng: np.random.Generator) -> tuple[Prism, ...]:
    """The prisms with `SHARE_MOVED` of the furniture moved within its rooms, off the ``route (P, 2)`` m, or
    removed where there is no other place."""
    pieces = _furniture(prisms)
    outlines = [_outline(prism) for prism in prisms]
    new = list(prisms)
    gone: set[int] = set()
    for piece in pieces:
        size = np.ptp(np.concatenate([prisms[k].footprint for k in piece]), axis=0).max()
        if size > LARGEST or rng.random() > SHARE_MOVED:
            continue
        others = cKDTree(
            np.concatenate([o for k, o in enumerate(outlines) if k not in piece and k not in gone])
        )
        placed = _place([prisms[k] for k in piece], others, cKDTree(route), rng)
        for k, prism in zip(piece, placed or [], strict=False):
            new[k], outlines[k] = prism, _outline(prism)
        gone.update([] if placed else piece)
    return tuple(prism for k, prism in enumerate(new) if k not in gone)


def _furniture(prisms: tuple[Prism, ...]) -> list[list[int]]:
    """Indices of the prisms of each piece of furniture: those whose boxes touch, seen from above."""
    rows = [k for k, prism in enumerate(prisms) if prism.kind == "furniture"]
    if not rows:
        return []
    low = np.array([prisms[k].footprint.min(axis=0) for k in rows]) - 0.01
    high = np.array([prisms[k].footprint.max(axis=0) for k in rows]) + 0.01
    touch = np.all((low[:, None] <= high[None]) & (low[None] <= high[:, None]), axis=2)
    _, label = connected_components(coo_array(touch), directed=False)
    return [[rows[i] for i in np.flatnonzero(label == k)] for k in range(label.max() + 1)]


def _outline(prism: Prism) -> Array:
    return resample(np.vstack([prism.footprint, prism.footprint[:1]]), 0.1)


def _place(
    piece: Sequence[Prism], others: cKDTree, route: cKDTree, rng: np.random.Generator
) -> list[Prism] | None:
    """The piece at another place of its room, None where no place is free."""
    centre = np.concatenate([prism.footprint for prism in piece]).mean(axis=0)
    for _ in range(TRIES):
        shift, turn = (
            rng.uniform(-FARTHEST, FARTHEST, 2),
            rng.choice([0.0, 0.5 * np.pi]) + rng.normal(0.0, 0.1),
        )
        T = se2.compose(np.array([*(centre + shift), turn]), np.array([*-centre, 0.0]))
        placed = [replace(prism, footprint=se2.transform(T, prism.footprint)) for prism in piece]
        outline = np.concatenate([_outline(prism) for prism in placed])
        way = centre + np.linspace(0.0, 1.0, 20)[:, None] * shift
        if min(others.query(outline)[0].min(), others.query(way)[0].min()) < 0.05:
            continue
        if route.query(outline)[0].min() > CLEARANCE:
            return placed
    return None


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
    r = np.nan_to_num(recording.ranges[rows])
    count = np.maximum(np.isfinite(recording.ranges[rows]).sum(axis=1), 1)
    shift = np.stack([(r * np.cos(bearing)).sum(axis=1), (r * np.sin(bearing)).sum(axis=1)], -1)
    return T_world_laser[:, :2] + shift / count[:, None]
