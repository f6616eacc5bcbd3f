"""Drawn rooms, and the same seen by a map that is bent by a known smooth field."""

from __future__ import annotations

from functools import cache
from itertools import pairwise

import numpy as np

from slam import se2
from slam.mapping.occupancy import Grid
from slam.mapping.submap import Submap
from slam.se2 import Array
from stitch.alignment.walls import surfaces

CELL = 0.1
T_A_B = np.array([4.0, -2.0, 0.6])
"""Where map b lies in map a."""
AMPLITUDE, WAVELENGTH = 0.6, 30.0
"""Of the field that bends b [m]."""


def field(points: Array) -> Array:
    """Displacement ``(n, 2)`` m of places ``(n, 2)`` m of a in map b's drawing of them."""
    phase = 2.0 * np.pi / WAVELENGTH * points
    return AMPLITUDE * np.stack([np.sin(phase[:, 1] + 1.0), np.sin(phase[:, 0])], -1)


def walls(seed: int = 3) -> list[tuple[float, float, float, float]]:
    """Segments of a house, about 30 × 20 m, with unequal rooms along a corridor and a wall aslant."""
    rng = np.random.default_rng(seed)
    high, low = 20.0 - rng.uniform(0.0, 5.0), rng.uniform(4.0, 8.0)
    lines = [(0.0, 0.0, 30.0, 0.0), (0.0, high, 30.0, high), (0.0, 0.0, 0.0, high), (30.0, 0.0, 30.0, high)]
    x, y = rng.uniform(9.0, 18.0), rng.uniform(1.0, 2.0)
    lines.append((x, y, x + 2.0, y + 1.5))
    for wall, far in ((low, 0.0), (low + rng.uniform(1.5, 3.0), high)):
        edges = np.array([0.0, *np.sort(rng.uniform(2.0, 28.0, 5)), 30.0]).tolist()
        for left, right in pairwise(edges):
            door = left + 0.3 * (right - left)
            lines += [(left, wall, door, wall), (min(door + 1.0, right), wall, right, wall)]
            lines.append((right, wall, right, far))
    return lines


def draw(
    lines: list[tuple[float, float, float, float]], low: float, high: float, T: Array, bent: bool
) -> Submap:
    """What lies between x = ``low`` and ``high`` m of a house, in a frame at ``T (3,)``, all of it free."""
    t = np.linspace(0.0, 1.0, 800)[:, None]
    points = np.concatenate([(1.0 - t) * line[:2] + t * np.array(line[2:]) for line in np.array(lines)])
    x, y = np.meshgrid(np.arange(0.02, 30.0, 0.05), np.arange(0.02, 20.0, 0.05))
    inside = np.stack([x.ravel(), y.ravel()], -1)
    cells = []
    for place in (points, inside):
        kept = place[(place[:, 0] >= low) & (place[:, 0] <= high)]
        moved = kept + field(kept) if bent else kept
        cells.append(np.floor(se2.transform(se2.inverse(T), moved) / CELL).astype(int))
    first = np.min([c.min(axis=0) for c in cells], axis=0) - 2
    columns, rows = np.max([c.max(axis=0) for c in cells], axis=0) - first + 3
    layers = []
    for c in cells:
        layer = np.zeros((rows, columns), dtype=bool)
        layer[c[:, 1] - first[1], c[:, 0] - first[0]] = True
        layers.append(layer)
    occupied, free = layers
    grid = Grid(occupied, free & ~occupied, first * CELL, CELL)
    return Submap(0, 1, np.zeros(3), surfaces(grid), grid)


@cache
def pair() -> tuple[Submap, Submap]:
    """The west two thirds of a house, and the east two thirds, bent."""
    lines = walls()
    return draw(lines, 0.0, 21.0, np.zeros(3), False), draw(lines, 8.0, 30.0, T_A_B, True)


@cache
def strangers() -> tuple[Submap, Submap]:
    """Two houses."""
    return draw(walls(), 0.0, 21.0, np.zeros(3), False), draw(walls(53), 8.0, 30.0, T_A_B, True)


def true_places(points: Array) -> Array:
    """Where points ``(n, 2)`` m of map b lie in map a."""
    drawn = se2.transform(T_A_B, points)
    places = drawn.copy()
    for _ in range(20):
        places = drawn - field(places)
    return places
