"""What speaks for an alignment: Hough spectra, X and Y spectra, and how the score falls off around it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from slam import se2
from slam.mapping.occupancy import Grid
from slam.se2 import Array
from stitch.alignment import hough
from stitch.alignment.config import AlignConfig
from stitch.alignment.raster import rasterise
from stitch.alignment.rotation import cross_correlation
from stitch.alignment.translation import (
    Correlation,
    correlate,
    correlation_along,
    padded_shape,
    profile,
    spectra,
)
from stitch.published.htms import DIRECTIONS, dominant_direction

RESOLUTION = 0.1
"""Side of the cells [m] that walls are counted in."""
REACH = 2.0
"""Half the width [m] of the score surface."""


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
class Axis:
    """Spectra of both maps along one direction, and their correlation: values and where the first lies [m],
    in steps of `RESOLUTION`."""

    a: Array
    first_a: float
    b: Array
    first_b: float
    correlation: Array
    first_shift: float
    shift: float


def rotation_correlation(a: Walls, b: Walls) -> Array:
    """Circular cross-correlation ``(180,)`` of the Hough spectra, largest 1; bin k is a turn of b by k°."""
    found = cross_correlation(a.spectrum, b.spectrum)
    return found / max(float(found.max()), np.finfo(float).tiny)


def axes(a: Walls, b: Walls, T_a_b: Array) -> tuple[Axis, Axis]:
    """X and Y spectra once both maps are turned to the walls of a and to each other (Formsma, section 3.5).

    ``shift`` is where the alignment ``T_a_b`` puts b.
    """
    direction = dominant_direction(a.spectrum)
    turned_a = a.points @ se2.rotation(-direction).T
    turned_b = b.points @ se2.rotation(T_a_b[2] - direction).T
    shift = se2.rotation(-direction) @ T_a_b[:2]
    x, y = (_axis(turned_a[:, k], turned_b[:, k], float(shift[k])) for k in (0, 1))
    return x, y


def _axis(a: Array, b: Array, shift: float) -> Axis:
    counts_a, first_a = profile(a, RESOLUTION)
    counts_b, first_b = profile(b, RESOLUTION)
    shifts, correlation = correlation_along(a, b, RESOLUTION)
    return Axis(
        counts_a, first_a * RESOLUTION, counts_b, first_b * RESOLUTION, correlation, float(shifts[0]), shift
    )


def surface(a: Walls, b: Walls, T_a_b: Array, config: AlignConfig) -> Correlation | None:
    """Agreement and conflict for shifts within `REACH` of an alignment; None for more than single submaps."""
    if a.grid is None or b.grid is None:
        return None
    still = rasterise(a.points, a.grid, np.zeros(3), RESOLUTION)
    moving = rasterise(b.points, b.grid, np.array([0.0, 0.0, T_a_b[2]]), RESOLUTION)
    shape = padded_shape(still, [moving])
    window = (T_a_b[:2] - REACH, T_a_b[:2] + REACH)
    return correlate(spectra(still, shape), spectra(moving, shape), config.search.blur, window)
