"""A smooth displacement field that is known, and a map bent by it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import map_coordinates

from slam.mapping.occupancy import Grid
from slam.mapping.submap import Submap
from slam.se2 import Array
from stitch.alignment.walls import surfaces
from stitch.command.maps import cropped

WAVES = 3
"""Waves whose sum bends a map, each along a direction of its own."""
WAVELENGTHS = (15.0, 40.0)
"""Shortest and longest of them [m]."""
THINNEST = 0.35
"""Share of a cell from which it is wall: at half, walls of a single cell get holes."""


@dataclass(frozen=True)
class SmoothField:
    """What a bent map shows at p was at ``p + u(p)``; u is a sum of K waves with wave vectors ``waves (K,
    2)`` rad/m, ``phases (K, 2)`` rad and ``heights (K, 2)`` m, by component of u."""

    waves: Array
    phases: Array
    heights: Array

    @classmethod
    def draw(cls, amplitude: float, rng: np.random.Generator) -> SmoothField:
        """A field that nowhere displaces by more than ``amplitude`` m on either axis."""
        turn, length = rng.uniform(0.0, 2.0 * np.pi, WAVES), rng.uniform(*WAVELENGTHS, WAVES)
        waves = (2.0 * np.pi / length)[:, None] * np.stack([np.cos(turn), np.sin(turn)], -1)
        heights = rng.uniform(0.5, 1.0, (WAVES, 2))
        phases = rng.uniform(0.0, 2.0 * np.pi, (WAVES, 2))
        return cls(waves, phases, amplitude * heights / heights.sum(axis=0))

    def undone(self, points: Array) -> Array:
        """Where points ``(n, 2)`` m of the bent map were."""
        phase = (points @ self.waves.T)[..., None] + self.phases
        return points + np.sum(self.heights * np.sin(phase), axis=-2)

    @property
    def reach(self) -> float:
        """The largest displacement on either axis [m]."""
        return float(np.max(self.heights.sum(axis=0)))


def bend_map(submap: Submap, field: SmoothField) -> Submap:
    """A map as it would be drawn bent, read off its cells as a published map is."""
    grid = submap.grid
    margin = int(np.ceil(field.reach / grid.resolution)) + 1
    height, width = grid.occupied.shape
    origin = grid.origin - margin * grid.resolution
    rows, columns = np.mgrid[: height + 2 * margin, : width + 2 * margin]
    centres = origin + (np.stack([columns.ravel(), rows.ravel()], -1) + 0.5) * grid.resolution
    cells = ((field.undone(centres) - grid.origin) / grid.resolution - 0.5).T[::-1]
    walls, free = (
        map_coordinates(layer.astype(np.float32), cells, order=1, cval=0.0).reshape(rows.shape)
        for layer in (grid.occupied, grid.free)
    )
    occupied = walls > THINNEST
    bent = cropped(Grid(occupied, (free > 0.5) & ~occupied, origin, grid.resolution))
    return replace(submap, points=surfaces(bent), grid=bent)
