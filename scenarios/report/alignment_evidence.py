"""What an alignment was made of and what speaks for it: the walls of both maps, their Hough spectra, their X
and Y spectra, and how the score falls off around it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np

from scenarios.report.method_attributes import merges_in_sequence
from slam import se2
from slam.mapping.occupancy import Grid
from slam.se2 import Array
from stitch.alignment import hough
from stitch.alignment.config import AlignConfig
from stitch.alignment.hough import cross_correlation
from stitch.alignment.raster import rasterise
from stitch.alignment.result import Stitch
from stitch.alignment.translation import (
    Correlation,
    correlate,
    correlation_along,
    padded_shape,
    profile,
    spectra,
)
from stitch.mapping.estimate import Estimate, LoopCandidate
from stitch.published.spectra import DIRECTIONS, dominant_direction

RESOLUTION = 0.1
"""Side of the cells [m] that walls are counted in."""
REACH = 2.0
"""Half the width [m] of the score surface."""
State = Literal["accepted", "false", "rejected", "refused"]
"""Of a candidate: in the map; in the map and untrue; rejected by the graph; refused by the alignment."""


@dataclass(frozen=True)
class Walls:
    """Wall points ``(n, 2)`` m of a map in its own frame, and its grid where it is one submap."""

    points: Array
    grid: Grid | None

    @cached_property
    def spectrum(self) -> Array:
        """Hough spectrum ``(180,)``, one bin a degree."""
        return hough.spectrum(hough.transform(self.points, DIRECTIONS, RESOLUTION, split=False))


@dataclass(frozen=True)
class AxisSpectra:
    """Spectra of both maps along one direction, and their correlation: values and where the first lies [m],
    in steps of `RESOLUTION`."""

    a: Array
    first_a: float
    b: Array
    first_b: float
    correlation: Array
    first_shift: float
    shift: float


@dataclass(frozen=True)
class AlignedPair:
    """A candidate of an estimate with its evidence: walls of ``a`` and ``b``, each in its own frame; where b
    was in the frame of a ``before``; and where the alignment, or the best candidate of a refusal, puts it
    (``T_a_b``, None where there is neither)."""

    a: Walls
    b: Walls
    before: Array
    T_a_b: Array | None

    @classmethod
    def of(cls, estimate: Estimate, candidate: LoopCandidate) -> AlignedPair:
        """The pair of a candidate; where methods merge in sequence a is the map of all submaps before b."""
        merges = merges_in_sequence(estimate.method)
        a = merged_walls(estimate, candidate.b) if merges else walls_of(estimate, candidate.a)
        return cls(a, walls_of(estimate, candidate.b), before(estimate, candidate), pose_of(candidate))

    @property
    def complete(self) -> bool:
        """Whether there is an alignment, and walls on both sides."""
        return self.T_a_b is not None and len(self.a.points) > 0 and len(self.b.points) > 0


def state_of(candidate: LoopCandidate, false: bool | None) -> State:
    """What became of a candidate, of which truth says whether it is ``false``, None without truth."""
    if not isinstance(candidate.result, Stitch):
        return "refused"
    if not candidate.accepted:
        return "rejected"
    return "false" if false else "accepted"


def pose_of(candidate: LoopCandidate) -> Array | None:
    """Where the stitch, or the best candidate of a refusal, has b in the frame of a."""
    if isinstance(candidate.result, Stitch):
        return candidate.result.T_a_b
    return None if candidate.result.best is None else candidate.result.best.T_a_b


def before(estimate: Estimate, candidate: LoopCandidate) -> Array:
    """Where b was in the frame of a when the submaps were drawn."""
    return se2.between(estimate.submaps[candidate.a].anchor, estimate.submaps[candidate.b].anchor)


def walls_of(estimate: Estimate, k: int) -> Walls:
    """The walls of one submap."""
    grid = estimate.submaps[k].grid
    return Walls(grid.occupied_points(), grid)


def merged_walls(estimate: Estimate, b: int) -> Walls:
    """The walls of all submaps before ``b`` where the method put them (before, where it refused them), in the
    frame of the first, thinned to cells."""
    parts = [estimate.submaps[0].grid.occupied_points()]
    for other in estimate.stitches:
        if other.b < b:
            T = other.result.T_a_b if isinstance(other.result, Stitch) else before(estimate, other)
            parts.append(se2.transform(T, estimate.submaps[other.b].grid.occupied_points()))
    cells = np.unique(np.floor(np.concatenate(parts) / RESOLUTION).astype(np.int64), axis=0)
    return Walls((cells + 0.5) * RESOLUTION, None)


def rotation_correlation(a: Walls, b: Walls) -> Array:
    """Circular cross-correlation ``(180,)`` of the Hough spectra, largest 1; bin k is a turn of b by k°."""
    correlation = cross_correlation(a.spectrum, b.spectrum)
    return correlation / max(float(correlation.max()), np.finfo(float).tiny)


def axis_spectra(a: Walls, b: Walls, T_a_b: Array) -> tuple[AxisSpectra, AxisSpectra]:
    """X and Y spectra once both maps are turned to the walls of a and to each other (thesis, section 3.5).

    ``shift`` is where the alignment ``T_a_b`` puts b.
    """
    direction = dominant_direction(a.spectrum)
    turned_a = a.points @ se2.rotation(-direction).T
    turned_b = b.points @ se2.rotation(T_a_b[2] - direction).T
    shift = se2.rotation(-direction) @ T_a_b[:2]
    x, y = (_along_axis(turned_a[:, k], turned_b[:, k], float(shift[k])) for k in (0, 1))
    return x, y


def _along_axis(a: Array, b: Array, shift: float) -> AxisSpectra:
    counts_a, first_a = profile(a, RESOLUTION)
    counts_b, first_b = profile(b, RESOLUTION)
    shifts, correlation = correlation_along(a, b, RESOLUTION)
    return AxisSpectra(
        counts_a, first_a * RESOLUTION, counts_b, first_b * RESOLUTION, correlation, float(shifts[0]), shift
    )


def score_surface(a: Walls, b: Walls, T_a_b: Array, config: AlignConfig) -> Correlation | None:
    """Agreement and conflict for shifts within `REACH` of an alignment; None for more than single submaps."""
    if a.grid is None or b.grid is None:
        return None
    still = rasterise(a.points, a.grid, np.zeros(3), RESOLUTION)
    moving = rasterise(b.points, b.grid, np.array([0.0, 0.0, T_a_b[2]]), RESOLUTION)
    shape = padded_shape(still, [moving])
    window = (T_a_b[:2] - REACH, T_a_b[:2] + REACH)
    return correlate(spectra(still, shape), spectra(moving, shape), config.search.blur, window)
