"""Hough transform and Hough spectrum of points: which directions do the walls have?"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from slam.se2 import Array
from stitch.alignment.config import DirectionConfig


@dataclass(frozen=True)
class Hough:
    """Votes ``(n_theta, n_rho)`` for the lines ``x cosθ + y sinθ = ρ`` about the frame's origin.

    Row k is ``θ = kπ/n_theta``, column i is ``ρ = first + i·resolution`` [m].
    """

    votes: Array
    first: float
    resolution: float


def transform(points: Array, n_theta: int = 360, resolution: float = 0.05, split: bool = True) -> Hough:
    """Hough transform of points ``(n, 2)`` m (Duda & Hart 1972).

    Votes are split linearly between two bins of ρ (as Censi's program does), or given whole to the bin that
    the point is in. Bins are half a cell off the frame's origin, so that the centres of a grid's cells lie in
    the middle of bins where lines run along the grid.
    """
    from stitch.alignment.hough_kernels import vote

    points = np.ascontiguousarray(points, dtype=np.float64)
    first, n_rho = _bins(points, resolution)
    if split:
        return Hough(vote(points, n_theta, first, resolution, n_rho), first, resolution)
    votes = np.zeros((n_theta, n_rho))
    for k, theta in enumerate(np.arange(n_theta) * np.pi / n_theta):
        rho = points @ np.array([np.cos(theta), np.sin(theta)])
        votes[k] = np.bincount(np.rint((rho - first) / resolution).astype(int), minlength=n_rho)
    return Hough(votes, first, resolution)


def _bins(points: Array, resolution: float) -> tuple[float, int]:
    """The first bin's ρ [m] and the number of bins that hold points ``(n, 2)``, whatever the direction."""
    reach = int(np.ceil(np.linalg.norm(points, axis=1).max(initial=0.0) / resolution)) + 1
    return -(reach + 0.5) * resolution, 2 * reach + 2


def spectrum(hough: Hough) -> Array:
    """Hough spectrum ``(n_theta,)``: the sum of squared votes of each direction, largest 1 (Censi 2005).

    Zero everywhere when there were no points.
    """
    return _normalised(np.einsum("kr,kr->k", hough.votes, hough.votes))


def spectrum_of(points: Array, n_theta: int = 360, resolution: float = 0.05) -> Array:
    """`spectrum` ``(n_theta,)`` of the `transform` of points ``(n, 2)`` m, kept nowhere: twice as fast."""
    from stitch.alignment.hough_kernels import energies

    points = np.ascontiguousarray(points, dtype=np.float64)
    first, n_rho = _bins(points, resolution)
    return _normalised(energies(points, n_theta, first, resolution, n_rho))


def _normalised(energy: Array) -> Array:
    return energy / max(float(energy.max()), np.finfo(float).tiny)


@dataclass(frozen=True)
class SpectrumContrast:
    """How far the peaks of a Hough spectrum stand out: ``crest`` max/mean and ``variation`` sd/mean."""

    crest: float
    variation: float

    @classmethod
    def of(cls, spectrum: Array) -> SpectrumContrast:
        """That of a spectrum ``(n_theta,)``."""
        mean = float(spectrum.mean())
        if mean == 0.0:
            return cls(1.0, 0.0)
        return cls(float(spectrum.max()) / mean, float(spectrum.std()) / mean)

    def has_directions(self, config: DirectionConfig) -> bool:
        """True where the walls run along few directions."""
        return self.crest > config.min_crest and self.variation > config.min_variation
