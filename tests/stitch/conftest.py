"""Synthetic floor plans, and submaps as a laser would have seen them."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from slam import se2
from slam.mapping.occupancy import draw
from slam.mapping.submap import Submap
from slam.recording import Laser
from slam.scan import Scan
from slam.se2 import Array

LASER = Laser(range_max=12.0)
ANGLES = np.radians(np.arange(-180.0, 180.0, 2.0))


def box(x0: float, y0: float, x1: float, y1: float) -> list[list[float]]:
    """The four sides (x, y, x, y) of a rectangle."""
    return [[x0, y0, x1, y0], [x1, y0, x1, y1], [x1, y1, x0, y1], [x0, y1, x0, y0]]


def rooms(rng: np.random.Generator, width: float = 30.0, height: float = 20.0) -> Array:
    """Segments ``(S, 4)`` of a corridor with random rooms on both sides, each with a door and a cupboard."""
    low, high = 0.4 * height, 0.4 * height + 2.0
    walls = box(0.0, 0.0, width, height)
    for wall, far in ((low, 0.0), (high, height)):
        edges = [0.0, *np.cumsum(rng.uniform(2.5, 5.5, 20))]
        edges = [*[e for e in edges if e < width - 2.5], width]
        for left, right in pairwise(edges):
            door = rng.uniform(left + 0.3, right - 1.3)
            walls += [[left, wall, door, wall], [door + 1.0, wall, right, wall], [right, wall, right, far]]
            x, y = rng.uniform(left + 0.3, right - 1.3), far + np.sign(wall - far) * rng.uniform(1.5, 4.5)
            w, h = rng.uniform(0.4, 1.0, 2)
            walls += box(x, y - h / 2.0, x + w, y + h / 2.0)
    return np.array(walls)


def cast(segments: Array, poses: Array) -> Array:
    """Ranges ``(N, B)`` m from poses ``(N, 3)`` to the nearest segment, NaN beyond the laser's range."""
    bearing = poses[:, 2:] + ANGLES
    d = np.stack([np.cos(bearing), np.sin(bearing)], -1)[..., None, :]
    start, side = segments[:, :2] - poses[:, None, None, :2], segments[:, 2:] - segments[:, :2]
    cross = d[..., 0] * side[:, 1] - d[..., 1] * side[:, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        r = (start[..., 0] * side[:, 1] - start[..., 1] * side[:, 0]) / cross
        u = (start[..., 0] * d[..., 1] - start[..., 1] * d[..., 0]) / cross
    hit = np.where((r > 0.0) & (u >= 0.0) & (u <= 1.0), r, np.inf).min(axis=-1)
    return np.where(hit < LASER.range_max, hit, np.nan)


def scan_of(points: Array) -> Scan:
    """Points without anything known about the surface."""
    n = len(points)
    nothing = np.full((n, 2), np.nan)
    return Scan(
        points, nothing, nothing, np.tile(1e-4 * np.eye(2), (n, 1, 1)), np.full(n, np.nan), np.arange(n)
    )


def see(
    segments: Array, poses: Array, anchor: Array, rng: np.random.Generator, noise: float = 0.01
) -> Submap:
    """The submap, in the frame of ``anchor (3,)``, of scans taken at world poses ``(N, 3)``."""
    ranges = cast(segments, poses)
    ranges = ranges + rng.normal(0.0, noise, ranges.shape)
    local = se2.between(anchor, poses)
    scans = [
        Scan.from_ranges(row, ANGLES, LASER).transformed(T) for row, T in zip(ranges, local, strict=True)
    ]
    return Submap(0, len(poses), anchor, Scan.merged(scans), draw(local, ranges, ANGLES, LASER, 0.05))


def walk(rng: np.random.Generator, x0: float, x1: float, n: int = 40) -> Array:
    """Poses ``(n, 3)`` spread over a stretch of the plan of `rooms`: most in the corridor."""
    x = np.linspace(x0, x1, n)
    y = np.where(np.arange(n) % 3 == 0, rng.uniform(2.0, 18.0, n), 9.0)
    return np.stack([x, y, rng.uniform(-np.pi, np.pi, n)], -1)


def pair(seed: int, overlap: float) -> tuple[Submap, Submap, Array]:
    """Two submaps that share ``overlap`` m of a 30 m building, anchored far apart, and the truth."""
    rng = np.random.default_rng(seed)
    segments = rooms(rng)
    anchors = np.array([[8.0, 9.0, rng.uniform(-3.0, 3.0)], [20.0, 9.0, rng.uniform(-3.0, 3.0)]])
    walks = (walk(rng, 1.5, 15.0 + overlap / 2), walk(rng, 15.0 - overlap / 2, 28.5))
    a, b = (see(segments, w, T, rng) for w, T in zip(walks, anchors, strict=True))
    return a, b, se2.between(anchors[0], anchors[1])


def stones() -> tuple[Submap, Submap, Array]:
    """Two submaps of a field of stones, whose walls have no directions, and the truth."""
    rng = np.random.default_rng(8)
    sides = []
    for x, y in rng.uniform(-6.0, 6.0, (40, 2)):
        turn, size = rng.uniform(0.0, 2.0 * np.pi), rng.uniform(0.2, 0.5)
        corner = [x, y] + size * np.stack([np.cos(turn + np.arange(6)), np.sin(turn + np.arange(6))], -1)
        sides += [[*p, *q] for p, q in zip(corner, np.roll(corner, -1, axis=0), strict=True)]
    poses = np.column_stack([rng.uniform(-4.0, 4.0, (30, 2)), rng.uniform(-3.0, 3.0, 30)])
    anchors = np.array([[0.0, 1.0, 0.4], [2.0, -1.0, 2.3]])
    a, b = (see(np.array(sides), poses, anchor, rng) for anchor in anchors)
    return a, b, se2.between(anchors[0], anchors[1])


@pytest.fixture(scope="session")
def plan() -> dict[str, Callable[..., Any]]:
    """The builders above, by name."""
    return {f.__name__: f for f in (box, rooms, cast, see, walk, scan_of, pair, stones)}
