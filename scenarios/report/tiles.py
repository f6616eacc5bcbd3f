"""Many small maps on one sheet, each drawn as large as its tile allows."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial import cKDTree

from scenarios.report.style import BLACK, BLUE, FONT, ORANGE, WIDTH
from slam.se2 import Array

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MOST = 60
"""Tiles on a sheet."""
NEAR = 0.15
"""Walls of two pieces nearer than this [m] are in both: one cell of 0.1 m, also across its corner."""
MAP, TITLE = 0.9, 0.16
"""Of a tile: share that the map fills, height of the line above it."""


@dataclass(frozen=True)
class Tile:
    """A small map: points ``(n, 2)`` m by colour, what lies on top last; its title and the title's colour."""

    title: str
    layers: tuple[tuple[Array, str], ...]
    colour: str = BLACK


def pair(title: str, a: Array, b: Array, colour: str = BLACK) -> Tile:
    """Two pieces in one frame: ``a`` blue, ``b`` orange, what both have black."""
    found = in_both(a, b)
    return Tile(title, ((a, BLUE), (b[~found], ORANGE), (b[found], BLACK)), colour)


def in_both(a: Array, b: Array) -> np.ndarray:
    """Which of the wall points ``b (m, 2)`` are also in ``a (n, 2)``, ``(m,)`` bool."""
    if len(a) == 0 or len(b) == 0:
        return np.zeros(len(b), dtype=bool)
    return np.isfinite(cKDTree(a).query(b, distance_upper_bound=NEAR)[0])


def sheet(tiles: Sequence[Tile], columns: int = 8) -> Figure:
    """The tiles in rows, the first `MOST` of them; each title with the larger side of what it shows."""
    from matplotlib.figure import Figure

    shown = tiles[:MOST]
    columns = min(columns, max(len(shown), 3))
    rows = math.ceil(len(shown) / columns)
    side = WIDTH / columns
    height = rows * side * (1.0 + TITLE) + (0.35 if len(tiles) > MOST else 0.05)
    figure = Figure(figsize=(WIDTH, height))
    ax = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    ax.set(xlim=(0.0, columns), ylim=(-height / side, 0.0))
    ax.set_axis_off()
    by_colour: dict[str, list[Array]] = {}
    for i, tile in enumerate(shown):
        corner = np.array([i % columns, -(i // columns) * (1.0 + TITLE)])
        middle, size = _box(tile)
        for points, colour in tile.layers:
            placed = corner + [0.5, -TITLE - 0.5] + MAP * (points - middle) / size
            by_colour.setdefault(colour, []).append(placed)
        ax.text(
            corner[0] + 0.5, corner[1] - 0.6 * TITLE, f"{tile.title}, {size:.0f} m",
            ha="center", va="center", fontsize=FONT["tick"], color=tile.colour, parse_math=False,
        )  # fmt: skip
    for colour in (BLUE, ORANGE, BLACK):
        if colour in by_colour:
            x, y = np.concatenate(by_colour[colour]).T
            ax.scatter(x, y, s=1.6, color=colour, linewidths=0, rasterized=True)
    if len(tiles) > MOST:
        left_out = f"and {len(tiles) - MOST} more"
        ax.text(columns / 2, 0.1 - height / side, left_out, fontsize=FONT["tick"], ha="center")
    return figure


def _box(tile: Tile) -> tuple[Array, float]:
    """Middle ``(2,)`` and larger side [m] of what a tile shows."""
    points = np.concatenate([points for points, _ in tile.layers])
    if len(points) == 0:
        return np.zeros(2), 1.0
    low, high = points.min(axis=0), points.max(axis=0)
    return (low + high) / 2.0, max(float((high - low).max()), 1.0)
