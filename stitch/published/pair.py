"""Two submaps as the published methods see them: the cells of their grids, nothing of their points."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from slam import se2
from slam.mapping.occupancy import Grid
from slam.mapping.submap import Submap
from slam.se2 import Array
from stitch.alignment import hough
from stitch.alignment.config import AlignConfig
from stitch.alignment.raster import rasterise
from stitch.alignment.result import Alternative, NoStitch, Prior, Stitch
from stitch.alignment.verification import measure

EXCLUDED = 16.27
"""Squared Mahalanobis distance from a prior beyond which it excludes an alignment: χ²₃ at 99.9 %."""


@dataclass(frozen=True)
class Pair:
    """Submaps with the centres ``walls_a (n, 2)``, ``walls_b (m, 2)`` m of their occupied cells."""

    a: Submap
    b: Submap
    walls_a: Array
    walls_b: Array
    config: AlignConfig

    def spectra(self, n_theta: int, split: bool) -> tuple[Array, Array]:
        """Hough spectra ``(n_theta,)`` of both maps, with bins of ρ of the raster's resolution."""
        of_a, of_b = (
            hough.spectrum(hough.transform(walls, n_theta, self.config.resolution, split))
            for walls in (self.walls_a, self.walls_b)
        )
        return of_a, of_b

    def stitch(self, best: Alternative, others: list[Alternative]) -> Stitch:
        """The answer, measured like that of any other method; it has no covariance."""
        resolution = self.config.resolution
        still = rasterise(self.walls_a, self.a.grid, np.zeros(3), resolution)
        evidence = measure(still, rasterise(self.walls_b, self.b.grid, best.T_a_b, resolution))
        return Stitch(
            T_a_b=best.T_a_b,
            covariance=None,
            score=best.score,
            overlap_area=evidence.overlap_area,
            agreement=evidence.agreement,
            alternatives=tuple(sorted(others, key=lambda other: -other.score)),
        )


def pair(a: Submap, b: Submap, config: AlignConfig) -> Pair | NoStitch:
    """Both submaps, or which of them has no walls."""
    walls_a, walls_b = a.grid.occupied_points(), b.grid.occupied_points()
    for name, walls in (("a", walls_a), ("b", walls_b)):
        if len(walls) == 0:
            return NoStitch(f"submap {name} has no occupied cells")
    return Pair(a, b, walls_a, walls_b, config)


def near(candidates: list[Alternative], prior: Prior | None) -> list[Alternative]:
    """Candidates that the prior does not exclude; all of them without a prior."""
    if prior is None:
        return candidates
    return [candidate for candidate in candidates if prior.distance(candidate.T_a_b) <= EXCLUDED]


@dataclass(frozen=True)
class Cells:
    """Cells ``occupied (H, W)`` and ``free (H, W)`` whose cell (0, 0) is cell ``first (2,)`` of the lattice.

    The lattice has one corner in the frame's origin. Nothing is thinned or left out, other than in a
    `stitch.alignment.raster.Raster`.
    """

    occupied: np.ndarray
    free: np.ndarray
    first: np.ndarray


def redraw(grid: Grid, T: Array, resolution: float) -> Cells:
    """A grid moved by ``T (3,)`` onto the lattice of ``resolution`` m, finer or coarser.

    A cell is occupied when the grid is at its centre (walls keep closed when cells get finer) or when the
    centre of an occupied cell falls into it (walls are not lost when they get coarser).
    """
    from stitch.alignment.kernels import look_up

    x_min, x_max, y_min, y_max = grid.extent
    corners = se2.transform(T, np.array([[x_min, y_min], [x_max, y_min], [x_min, y_max], [x_max, y_max]]))
    first = np.floor(corners.min(axis=0) / resolution)
    width, height = (np.ceil(corners.max(axis=0) / resolution) - first).astype(int)
    occupied, free = (
        look_up(cells, grid.origin, grid.resolution, T, first, (height, width), resolution)
        for cells in (grid.occupied, grid.free)
    )
    column, row = (np.floor(se2.transform(T, grid.occupied_points()) / resolution) - first).astype(int).T
    # a centre on the border may round to either side of it
    occupied[np.clip(row, 0, height - 1), np.clip(column, 0, width - 1)] = True
    return Cells(occupied, free & ~occupied, first)
