"""The building that the ray caster is timed in: rooms with doors and cupboards, as thin walls, of constant
density: 40 × 30 m for 200 segments, ten times as large for ten times as many.
"""

from __future__ import annotations

import math

import numpy as np

from slam.se2 import Array

SIZE = (40.0, 30.0)
"""The building of `SEGMENTS` segments [m]."""
SEGMENTS = 200
ROOM = 5.0
"""Mean side of a room [m]."""
DOOR = 1.0
CUPBOARD = ((0.8, 0.4), (1.6, 0.6))
"""Smallest and largest length and depth [m]."""


def building(segments: int, rng: np.random.Generator) -> Array:
    """Walls ``(segments, 4)`` m of one building, its south-west corner at the origin.

    A jittered grid of rooms with a door in every wall between two of them; a cupboard (or a single wall) in
    some of the rooms makes up the number. Raises ``ValueError`` for fewer than the four outer walls.
    """
    if segments < 4:
        raise ValueError(f"segments: expected 4 or more, got {segments}")
    width, depth = np.array(SIZE) * math.sqrt(segments / SEGMENTS)
    x, y = _grid_lines(width, rng), _grid_lines(depth, rng)
    corners = np.array([[0.0, 0.0], [width, 0.0], [width, depth], [0.0, depth]])
    outer = np.hstack([corners, np.roll(corners, -1, axis=0)])
    upright, level = _walls_with_doors(x, y, rng), _walls_with_doors(y, x, rng)[:, [1, 0, 3, 2]]
    walls = np.vstack([outer, upright, level])
    left = segments - len(walls)
    return np.vstack([walls, _cupboards(math.ceil(left / 4), x, y, rng)[:left]])


def free_poses(walls: Array, count: int, rng: np.random.Generator, clearance: float = 0.35) -> Array:
    """Poses ``(count, 3)`` inside the building of ``walls (S, 4)``, ``clearance`` m off all of them."""
    upper = walls.reshape(-1, 2).max(axis=0)
    poses: list[Array] = []
    while len(poses) < count:
        point = rng.uniform(clearance, upper - clearance)
        if _distance(point, walls) > clearance:
            poses.append(np.array([*point, rng.uniform(-np.pi, np.pi)]))
    return np.array(poses)


def _grid_lines(length: float, rng: np.random.Generator) -> Array:
    """Where the walls between rooms stand along one axis, both ends included."""
    rooms = max(1, int(length / ROOM))
    lines = np.linspace(0.0, length, rooms + 1)
    lines[1:-1] += rng.uniform(-0.15, 0.15, rooms - 1) * ROOM
    return lines


def _walls_with_doors(x: Array, y: Array, rng: np.random.Generator) -> Array:
    """Walls at every inner ``x`` between neighbouring ``y``, in two pieces with a door between them."""
    at, low = (grid.ravel() for grid in np.meshgrid(x[1:-1], y[:-1], indexing="ij"))
    high = np.tile(y[1:], len(x) - 2)
    door = rng.uniform(low + DOOR, high - DOOR)
    pieces = [[at, low, at, door - 0.5 * DOOR], [at, door + 0.5 * DOOR, at, high]]
    return np.concatenate([np.transpose(piece) for piece in pieces])


def _cupboards(count: int, x: Array, y: Array, rng: np.random.Generator) -> Array:
    """Outlines ``(4 count, 4)`` m of boxes at any angle, in as many rooms as there are."""
    rooms = (len(x) - 1) * (len(y) - 1)
    i, j = np.divmod(np.resize(rng.permutation(rooms), count), len(y) - 1)
    half = 0.5 * rng.uniform(*CUPBOARD, (count, 2))
    reach = np.hypot(*half.T)
    cx = rng.uniform(x[i] + reach, x[i + 1] - reach)
    cy = rng.uniform(y[j] + reach, y[j + 1] - reach)
    yaw = rng.uniform(-np.pi, np.pi, count)
    u = half[:, None, 0] * [-1, 1, 1, -1]
    v = half[:, None, 1] * [-1, -1, 1, 1]
    c, s = np.cos(yaw)[:, None], np.sin(yaw)[:, None]
    corners = np.stack([cx[:, None] + c * u - s * v, cy[:, None] + s * u + c * v], -1)
    return np.concatenate([corners, np.roll(corners, -1, axis=1)], axis=2).reshape(-1, 4)


def _distance(point: Array, walls: Array) -> float:
    """Smallest distance [m] from a point (2,) to segments (S, 4)."""
    a, e = walls[:, :2] - point, walls[:, 2:] - walls[:, :2]
    t = np.clip(-np.sum(a * e, axis=1) / np.sum(e * e, axis=1), 0.0, 1.0)
    return float(np.hypot(*(a + t[:, None] * e).T).min())
