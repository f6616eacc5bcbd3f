"""Loops over points and directions of the Hough transform and its spectrum."""

from __future__ import annotations

import numpy as np
from numba import njit

from slam.se2 import Array


@njit(cache=True)
def vote(points: Array, n_theta: int, first: float, resolution: float, n_rho: int) -> Array:
    """Hough transform ``(n_theta, n_rho)`` of points ``(n, 2)``, each vote split between two bins.

    Bin i of ρ is centred on ``first + i·resolution``.
    """
    votes = np.zeros((n_theta, n_rho))
    start = first / resolution
    for k in range(n_theta):
        c, s = np.cos(np.pi * k / n_theta) / resolution, np.sin(np.pi * k / n_theta) / resolution
        for j in range(points.shape[0]):
            at = points[j, 0] * c + points[j, 1] * s - start
            i = int(at)  # never negative
            votes[k, i] += 1.0 - (at - i)
            votes[k, i + 1] += at - i
    return votes


@njit(cache=True)
def energies(points: Array, n_theta: int, first: float, resolution: float, n_rho: int) -> Array:
    """Sums ``(n_theta,)`` of the squared votes of each direction, without keeping the votes as `vote` does.

    A bin is one integer, so that a vote is one addition: its high bits count points, its low bits sum the
    shares of them that go to the next bin, to 2⁻³⁰ or better for fewer than 2¹⁶ points.
    """
    bits, rho_bits = 1, 1  # that hold the number of points, and of bins
    while points.shape[0] >> bits:
        bits += 1
    while n_rho >> rho_bits:
        rho_bits += 1
    fine, start = 62 - max(2 * bits, rho_bits), first / resolution
    scale, share, one = float(1 << fine), (1 << fine) - 1, 1 << (fine + bits)
    bins, out = np.zeros(n_rho, dtype=np.int64), np.zeros(n_theta)
    for k in range(n_theta):
        c, s = np.cos(np.pi * k / n_theta) / resolution, np.sin(np.pi * k / n_theta) / resolution
        c, s, origin = scale * c, scale * s, scale * start
        for j in range(points.shape[0]):
            at = np.int64(points[j, 0] * c + points[j, 1] * s - origin)  # never negative
            bins[np.uint64(at >> fine)] += (at & share) | one
        before, energy = 0.0, 0.0
        for i in range(n_rho):
            held = bins[i]
            if held == 0 and before == 0.0:
                continue
            beyond = (held & (one - 1)) / scale
            votes = (held >> (fine + bits)) - beyond + before
            energy += votes * votes
            before, bins[i] = beyond, 0
        out[k] = energy
    return out
