"""What a laser sees of things that move: a pass over them after the still world has been cast."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import ArrayLike

from sim.beams import beam_directions
from sim.terrain import heights_at
from sim.traversal import _chord, _solid_hit
from sim.world import Obstacles, World
from slam.se2 import Array


@dataclass(frozen=True)
class Sightings:
    """Solids in their body frames, and their poses ``(N, K, 4)`` at N scans: x, y, yaw and ground height."""

    solids: Obstacles
    poses: Array

    @classmethod
    def of(cls, world: World, movers: ArrayLike) -> Sightings:
        """The world's movers at poses ``(N, K, 3)``, each standing on the ground under it."""
        movers = np.ascontiguousarray(movers, dtype=np.float64)
        ground = heights_at(movers[..., :2].reshape(-1, 2), world.terrain.field)
        return cls(world.mover_solids, np.dstack([movers, ground.reshape(movers.shape[:2])]))

    def without_heights(self) -> Sightings:
        """The same, endlessly high."""
        return Sightings(self.solids.without_heights(), self.poses)

    def cast(self, poses: Array, angles: Array, ranges: Array, cosines: Array) -> None:
        """Put nearer hits into ``ranges`` and ``cosines (N, B)``, of sensor ``poses (N, 6)`` and ``angles (B,)``."""
        radius = np.array(
            [
                np.hypot(*self.solids.edges[a:b, :2].T).max()
                for a, b in zip(self.solids.first[:-1], self.solids.first[1:], strict=True)
            ]
        )
        _cast_movers(poses, angles, self.solids, self.poses, radius, ranges, cosines)
