"""Two submaps as the published methods see them: the cells of their grids, nothing of their points."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from slam import se2
from slam.mapping.occupancy import Grid
from slam.mapping.submap import Submap
from slam.se2 import Array
from stitch.alignment import hough
from stitch.alignment.acceptance import measure_shared_area
from stitch.alignment.config import AlignConfig
from stitch.alignment.raster import Raster, lattice_window, look_up, rasterise
from stitch.alignment.result import Alternative, Prior, Stitch, max_distance


@dataclass(frozen=True)
class Pair:
    """Two submaps and how they are aligned."""

    a: Submap
    b: Submap
    config: AlignConfig

    @cached_property
    def walls_a(self) -> Array:
        """Centres ``(n, 2)`` m of the occupied cells of a."""
        return self.a.grid.occupied_points()

    @cached_property
    def walls_b(self) -> Array:
        """Centres ``(m, 2)`` m of the occupied cells of b."""
        return self.b.grid.occupied_points()

    def spectra(self, n_theta: int, split: bool) -> tuple[Array, Array]:
        """Hough spectra ``(n_theta,)`` of both maps, with bins of ρ of the raster's resolution."""
        transforms = (
            hough.transform(walls, n_theta, self.config.resolution, split)
            for walls in (self.walls_a, self.walls_b)
        )
        of_a, of_b = map(hough.spectrum, transforms)
        return of_a, of_b

    def stitch(self, best: Alternative, others: list[Alternative]) -> Stitch:
        """The best candidate as an answer, with the area shared there; it has no covariance."""
        resolution = self.config.resolution
        still = rasterise(self.walls_a, self.a.grid, np.zeros(3), resolution)
        moved = rasterise(self.walls_b, self.b.grid, best.T_a_b, resolution)
        shared = measure_shared_area(still, moved)
        ranked = tuple(sorted(others, key=lambda other: -other.score))
        return Stitch(best.T_a_b, None, best.score, shared.overlap_area, shared.agreement, ranked)


def near(candidates: list[Alternative], prior: Prior | None, config: AlignConfig) -> list[Alternative]:
    """Candidates that the prior does not exclude; all of them without a prior."""
    if prior is None:
        return candidates
    limit = max_distance(config.prior.confidence)
    return [candidate for candidate in candidates if prior.distance(candidate.T_a_b) <= limit]


def redraw(grid: Grid, T: Array, resolution: float) -> Raster:
    """A grid moved by ``T (3,)`` onto the lattice of ``resolution`` m, with nothing left out.

    A cell is occupied when the grid is at its centre (walls keep closed when cells get finer) or when the
    centre of an occupied cell falls into it (walls are not lost when they get coarser).
    """
    first, shape = lattice_window(grid, T, resolution)
    occupied, free = (
        look_up(cells, grid.origin, grid.resolution, T, first, shape, resolution)
        for cells in (grid.occupied, grid.free)
    )
    column, row = (np.floor(se2.transform(T, grid.occupied_points()) / resolution) - first).astype(int).T
    # a centre on the border may round to either side of it
    occupied[np.clip(row, 0, shape[0] - 1), np.clip(column, 0, shape[1] - 1)] = True
    return Raster(occupied, free & ~occupied, first, resolution)
