"""Hough transform and spectrum: which directions do the walls have, and which rotations bring two maps' walls
together?"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from slam import se2
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


def spectrum(hough: Hough) -> Array:
    """Hough spectrum ``(n_theta,)``: the sum of squared votes of each direction, largest 1 (Censi 2005).

    Zero everywhere when there were no points.
    """
    return _normalised(np.einsum("kr,kr->k", hough.votes, hough.votes))


def spectrum_of(points: Array, n_theta: int = 360, resolution: float = 0.05) -> Array:
    """`spectrum` ``(n_theta,)`` of the `transform` of points ``(n, 2)`` m, kept nowhere: twice as fast."""
    points = np.ascontiguousarray(points, dtype=np.float64)
    first, n_rho = _bins(points, resolution)
    return _normalised(energies(points, n_theta, first, resolution, n_rho))


def _normalised(energy: Array) -> Array:
    return energy / max(float(energy.max()), np.finfo(float).tiny)


def contrast(spectrum: Array) -> tuple[float, float]:
    """How far the peaks of a spectrum ``(n_theta,)`` stand out: max/mean (crest) and sd/mean (variation)."""
    mean = float(spectrum.mean())
    if mean == 0.0:
        return 1.0, 0.0
    return float(spectrum.max()) / mean, float(spectrum.std()) / mean


def has_directions(spectrum: Array, config: DirectionConfig) -> bool:
    """True where the walls run along few directions."""
    crest, variation = contrast(spectrum)
    return crest > config.min_crest and variation > config.min_variation


def cross_correlation(spectrum_a: Array, spectrum_b: Array) -> Array:
    """``C[k] = Σ_i HS_b[i] HS_a[i+k]``, circular; k·π/n_theta is the rotation from b's frame to a's.

    Raises ``ValueError`` for spectra of different length.
    """
    if spectrum_a.shape != spectrum_b.shape:
        raise ValueError(f"spectra of different length: {spectrum_a.shape} and {spectrum_b.shape}")
    product = np.conj(np.fft.rfft(spectrum_b)) * np.fft.rfft(spectrum_a)
    return np.fft.irfft(product, len(spectrum_a))


def hypotheses(
    spectrum_a: Array, spectrum_b: Array, n_peaks: int, separation: float, smoothing: float
) -> tuple[Array, Array]:
    """Rotations ``(m,)`` rad in ``[-π, π)`` that take b's walls to a's, best first, and scores ``(m,)``.

    They are the ``n_peaks`` best local maxima of the circular cross-correlation, at least ``separation`` rad
    apart, each followed by its twin half a turn away (lines do not tell θ from θ+π). With ``smoothing`` > 0
    rad the correlation is blurred by a Gaussian and peaks are placed between bins by a parabola; 0 takes the
    bin itself, as the thesis does (Formsma, section 3.3).
    """
    correlation = cross_correlation(spectrum_a, spectrum_b)
    n = len(correlation)
    if smoothing > 0.0:
        correlation = _blurred(correlation, smoothing * n / np.pi)
    places = peaks(correlation, n_peaks, separation * n / np.pi)
    scores = correlation[places]
    bins = places + _vertex_offsets(correlation, places) if smoothing > 0.0 else places
    angles = bins * np.pi / n
    return se2.wrap(np.stack([angles, angles + np.pi], -1).ravel()), np.repeat(scores, 2)


def common_directions(
    spectrum_a: Array, spectrum_b: Array, yaw: float, count: int, config: DirectionConfig
) -> Array:
    """Directions ``(m,)`` rad of lines that both maps have once b is turned by ``yaw``, strongest first.

    They are the ``count`` best local maxima of the product of the spectra, aligned to the bin (Censi 2005),
    that stand out; each is the angle of the lines' normal in a's frame, in ``[0, π)``.
    """
    n = len(spectrum_a)
    product = spectrum_a * np.roll(spectrum_b, round(yaw * n / np.pi))
    places = peaks(product, count, config.separation * n / np.pi)
    background = config.min_background_ratio * float(np.median(product))
    least = max(config.min_strength * float(product.max()), background)
    return places[product[places] >= least] * np.pi / n


def reason_against_directions(spectrum_a: Array, spectrum_b: Array, config: DirectionConfig) -> str | None:
    """Why walls do not fix a pose, in words: a map has no directions, or one only; None where they do.

    Carpin (2008) and Censi (2005) take it for granted that there are two.
    """
    for name, spectrum in (("a", spectrum_a), ("b", spectrum_b)):
        if not has_directions(spectrum, config):
            return f"the walls of submap {name} have no directions (crest {contrast(spectrum)[0]:.2f})"
        if len(common_directions(spectrum, spectrum, 0.0, 2, config)) < 2:
            return f"the walls of submap {name} have one direction, along which they are free to slide"
    return None


def _blurred(signal: Array, sigma: float) -> Array:
    """Circular signal ``(n,)`` blurred by a Gaussian of ``sigma`` bins."""
    n = len(signal)
    gain = np.exp(-2.0 * (np.pi * sigma * np.arange(n // 2 + 1) / n) ** 2)
    return np.fft.irfft(np.fft.rfft(signal) * gain, n)


def peaks(signal: Array, count: int, separation: float) -> np.ndarray:
    """Bins of the best local maxima of a circular signal, strongest first, ``separation`` bins apart."""
    n = len(signal)
    local = np.flatnonzero((signal >= np.roll(signal, 1)) & (signal > np.roll(signal, -1)))
    if local.size == 0:  # a constant: every rotation is as good as any other
        local = np.array([0])
    chosen: list[int] = []
    for k in local[np.argsort(-signal[local], kind="stable")]:
        if all(min((k - c) % n, (c - k) % n) >= separation for c in chosen):
            chosen.append(int(k))
        if len(chosen) == count:
            break
    return np.array(chosen)


def _vertex_offsets(signal: Array, places: np.ndarray) -> Array:
    """Offsets from bins ``places`` to the tops of the parabolas through them and their neighbours."""
    before, at, after = (signal[(places + d) % len(signal)] for d in (-1, 0, 1))
    curvature = before - 2.0 * at + after
    return np.where(curvature < 0.0, 0.5 * (before - after) / np.where(curvature < 0.0, curvature, 1.0), 0.0)
