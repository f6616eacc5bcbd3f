"""Two submaps and what the aligners that read Hough spectra ask of them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from slam import se2
from slam.mapping.submap import Submap
from slam.se2 import Array
from stitch.alignment import hough
from stitch.alignment.acceptance import measure_shared_area
from stitch.alignment.config import AlignConfig
from stitch.alignment.raster import rasterise
from stitch.alignment.result import Alternative, Prior, Stitch


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
    limit = se2.max_distance(config.prior.confidence)
    return [candidate for candidate in candidates if prior.distance(candidate.T_a_b) <= limit]
