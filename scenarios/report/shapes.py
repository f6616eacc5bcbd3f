"""Shapes of our own for the worked examples of the thesis' third chapter, with known answers."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from slam import se2
from slam.mapping.occupancy import Grid
from slam.mapping.submap import Submap
from slam.scan import Scan
from slam.se2 import Array

PIXEL = 0.05
"""Side of a drawn cell [m]."""
T_MAP_CUTOUT = np.array([9.5, 3.5, np.radians(79.0)])
"""Where the cut-out lies in the map of rooms."""
CUTOUT = 3.6
"""Radius of the cut-out [m]: round, so that its edge has no direction."""


def lines() -> Array:
    """Two lines, segments ``(2, 4)`` m: normals at 0° and 45°, 1.5 m and 0.5 m from the origin."""
    normal = np.array([1.0, 1.0]) / np.sqrt(2.0)
    along = np.array([-normal[1], normal[0]])
    slanted = [*(0.5 * normal - 2.0 * along), *(0.5 * normal + 2.0 * along)]
    return np.array([[1.5, -1.8, 1.5, 1.8], slanted])


def rooms() -> Array:
    """A floor of 12 x 8 m in segments ``(S, 4)`` m: rooms of different sizes with doors, walls at 0° and
    90°."""
    walls = [
        *_outline([(0.0, 0.0), (12.0, 0.0), (12.0, 8.0), (0.0, 8.0)]),
        (0.0, 4.6, 1.4, 4.6), (2.3, 4.6, 6.8, 4.6), (7.7, 4.6, 12.0, 4.6),
        (3.4, 0.0, 3.4, 2.6), (3.4, 3.5, 3.4, 4.6),
        (8.2, 0.0, 8.2, 0.7), (8.2, 1.6, 8.2, 4.6),
        (5.0, 4.6, 5.0, 6.9),
        (9.7, 5.7, 9.7, 8.0),
        (8.2, 2.9, 10.4, 2.9),
    ]  # fmt: skip
    furniture = [
        _outline([(5.2, 1.0), (6.4, 1.0), (6.4, 1.7), (5.2, 1.7)]),
        _outline([(0.6, 6.2), (1.5, 6.2), (1.5, 7.3), (0.6, 7.3)]),
        _outline([(10.9, 0.5), (11.5, 0.5), (11.5, 1.9), (10.9, 1.9)]),
    ]
    return np.array(walls + [side for piece in furniture for side in piece])


def hexagons() -> Array:
    """A round beehive of 19 chambers with sides of 1 m, segments ``(S, 4)`` m: normals at 0°, 60°, 120°."""
    corners = np.stack([np.sin(np.arange(6) * np.pi / 3), np.cos(np.arange(6) * np.pi / 3)], -1)
    walls: dict[tuple[float, float], tuple[float, float, float, float]] = {}
    for q in range(-2, 3):
        for r in range(max(-2, -2 - q), min(2, 2 - q) + 1):
            centre = np.array([np.sqrt(3.0) * (q + 0.5 * r), 1.5 * r])
            for side in _outline([(x, y) for x, y in centre + corners]):
                middle = (round(side[0] + side[2], 6), round(side[1] + side[3], 6))
                walls[middle] = side  # neighbours share a wall
    return np.array(list(walls.values()))


def _outline(corners: list[tuple[float, float]]) -> list[tuple[float, float, float, float]]:
    return [(*start, *end) for start, end in pairwise([*corners, corners[0]])]


def points_on(segments: Array) -> Array:
    """Points ``(n, 2)`` m on segments, closer than a pixel."""
    parts = []
    for segment in segments:
        count = int(np.ceil(np.hypot(*(segment[2:] - segment[:2])) / (0.5 * PIXEL))) + 1
        parts.append(segment[:2] + np.linspace(0.0, 1.0, count)[:, None] * (segment[2:] - segment[:2]))
    return np.concatenate(parts)


def rasterise_points(points: Array) -> Submap:
    """Points ``(n, 2)`` m as a submap of pixels; what is not a wall is free."""
    first = np.floor(points.min(axis=0) / PIXEL)
    column, row = (np.floor(points / PIXEL) - first).astype(int).T
    occupied = np.zeros((row.max() + 1, column.max() + 1), dtype=bool)
    occupied[row, column] = True
    grid = Grid(occupied, ~occupied, first * PIXEL, PIXEL)
    centres = grid.occupied_points()
    unknown = np.full_like(centres, np.nan)
    n = len(centres)
    covariance = np.tile(PIXEL**2 / 12.0 * np.eye(2), (n, 1, 1))
    scan = Scan(centres, unknown, unknown, covariance, np.full(n, np.nan), np.arange(n))
    return Submap(0, 1, np.zeros(3), scan, grid)


def rotate(points: Array, yaw: float) -> Array:
    """Points ``(n, 2)`` rotated by ``yaw`` rad about the origin."""
    return points @ se2.rotation(yaw).T


def map_and_cutout() -> tuple[Submap, Submap]:
    """The map of rooms and a round piece of it in a frame of its own, which lies at `T_MAP_CUTOUT`."""
    walls = points_on(rooms())
    piece = se2.transform(se2.inverse(T_MAP_CUTOUT), walls)
    return rasterise_points(walls), rasterise_points(piece[np.hypot(piece[:, 0], piece[:, 1]) <= CUTOUT])
