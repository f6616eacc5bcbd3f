"""Walls that a laser does not see as walls: glass, and mirrors."""

from __future__ import annotations

import numpy as np

from sim.corruption.beams import with_ranges
from sim.corruption.kind import Kind, Severity
from slam import se2
from slam.recording import Recording
from slam.se2 import Array

PANE = 1.0
"""Side [m] of the squares of the plane whose walls are of one stuff."""
BEHIND = (0.5, 4.0)
"""How far behind a pane of glass the next surface is [m]."""
TOUCHING = 0.02
"""A ray that starts on a wall meets it within this [m]."""
JOINED = 0.5
"""Neighbouring points of a scan nearer than this [m] are on one wall that a mirror shows."""


def points_of(recording: Recording) -> Array:
    """Where every beam ended ``(N, B, 2)`` m, in the frame of the truth, or of dead reckoning without."""
    robot = recording.dead_reckoning if recording.truth is None else recording.truth
    laser = se2.compose(robot, recording.laser.T_robot_laser)
    bearing = laser[:, 2:] + recording.angles
    direction = np.stack([np.cos(bearing), np.sin(bearing)], axis=-1)
    return laser[:, None, :2] + recording.ranges[:, :, None] * direction


def panes(points: Array, rng: np.random.Generator) -> tuple[np.ndarray, int]:
    """The number of the pane that each of the points ``(n, 2)`` is on, and how many panes there are. The
    squares lie anyhow, lest a wall run along a side of many."""
    lie = rng.uniform([0.0, 0.0, -np.pi], [PANE, PANE, np.pi])
    cells = np.floor(se2.transform(lie, points) / PANE).astype(np.int64)
    cells -= cells.min(axis=0, initial=0)
    _, pane = np.unique(cells[:, 0] * (cells[:, 1].max(initial=0) + 1) + cells[:, 1], return_inverse=True)
    return pane, int(pane.max(initial=-1)) + 1


def shine_through(recording: Recording, severity: float, rng: np.random.Generator) -> Recording:
    """A share of the panes is of glass: beams end on what is behind, as far behind for all of a pane."""
    there = np.isfinite(recording.ranges)
    pane, count = panes(points_of(recording)[there], rng)
    glass, behind = rng.random(count) < severity, rng.uniform(*BEHIND, count)
    ranges = recording.ranges.copy()
    ranges[there] += np.where(glass, behind, 0.0)[pane]
    return with_ranges(recording, ranges)


def mirror(recording: Recording, severity: float, rng: np.random.Generator) -> Recording:
    """A share of the panes is of mirrors: beams end, reflected, on what else the same scan sees, or
    nowhere."""
    there = np.isfinite(recording.ranges)
    pane, count = panes(points_of(recording)[there], rng)
    mirrored = np.zeros(there.shape, dtype=bool)
    mirrored[there] = (rng.random(count) < severity)[pane]
    ranges = recording.ranges.copy()
    for k in np.flatnonzero(mirrored.any(axis=1)):
        hit = np.flatnonzero(mirrored[k])
        ranges[k, hit] += reflected(recording.ranges[k], recording.angles, hit, recording.laser.range_max)
    return with_ranges(recording, ranges)


def reflected(ranges: Array, angles: Array, hit: np.ndarray, reach: float) -> Array:
    """How far beams ``hit (h,)`` of a scan of ``ranges (B,)`` m at ``angles (B,)`` rad go on from the mirror
    that they meet, NaN where they meet nothing within ``reach`` m."""
    seen = np.flatnonzero(np.isfinite(ranges))
    points = ranges[seen, None] * np.column_stack([np.cos(angles[seen]), np.sin(angles[seen])])
    place = np.searchsorted(seen, hit)
    along = points[np.minimum(place + 1, len(seen) - 1)] - points[np.maximum(place - 1, 0)]
    onward = 2.0 * np.arctan2(along[:, 1], along[:, 0]) - angles[hit]  # reflected at the line along the wall
    joined = np.hypot(*np.diff(points, axis=0).T) < JOINED
    walls = np.column_stack([points[:-1], points[1:]])[joined]
    far = first_hits(points[place], onward, walls)
    return np.where(far <= reach, far, np.nan)


def first_hits(start: Array, bearing: Array, walls: Array) -> Array:
    """How far rays from ``start (h, 2)`` m along ``bearing (h,)`` rad go until they meet one of the ``walls
    (S, 4)`` m, infinity where they meet none. A wall they start from does not count."""
    ahead = np.column_stack([np.cos(bearing), np.sin(bearing)])[:, None]
    along, off = walls[:, 2:] - walls[:, :2], walls[:, :2] - start[:, None]
    turn = _cross(ahead, along)
    with np.errstate(divide="ignore", invalid="ignore"):  # a ray along a wall meets it nowhere
        distance, share = _cross(off, along) / turn, _cross(off, ahead) / turn
    meets = (distance > TOUCHING) & (share >= 0.0) & (share <= 1.0)
    return np.min(np.where(meets, distance, np.inf), axis=1, initial=np.inf)


def _cross(a: Array, b: Array) -> Array:
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]


KINDS = (
    Kind(
        "laser.glass",
        "beams pass through panes of glass and end on what is behind",
        shine_through,
        Severity(f"share of the walls, in panes of {PANE:g} m", "", 0.0, 1.0, (0.1, 0.2, 0.4), 0.2),
    ),
    Kind(
        "laser.mirror",
        "beams are reflected by mirrors and end on what these show",
        mirror,
        Severity(f"share of the walls, in panes of {PANE:g} m", "", 0.0, 1.0, (0.05, 0.1, 0.2), 0.1),
    ),
)
"""The entries of this family."""
