"""Rotation hypotheses from two Hough spectra."""

from __future__ import annotations

import numpy as np

from slam import se2
from slam.se2 import Array
from stitch.alignment.hough import gridness

FAINTEST = 0.04
"""Least product of two spectra, of its maximum, that is a direction; the ends of a single wall have less."""
BACKGROUND = 2.0
"""Times the median of the product, which is what unrelated walls add to every direction."""


def cross_correlation(spectrum_a: Array, spectrum_b: Array) -> Array:
    """``C[k] = Σ_i HS_b[i] HS_a[i+k]``, circular; k·π/n_theta is the rotation from b's frame to a's."""
    if spectrum_a.shape != spectrum_b.shape:
        raise ValueError(f"spectra of different length: {spectrum_a.shape} and {spectrum_b.shape}")
    product = np.conj(np.fft.rfft(spectrum_b)) * np.fft.rfft(spectrum_a)
    return np.fft.irfft(product, len(spectrum_a))


def hypotheses(
    spectrum_a: Array,
    spectrum_b: Array,
    n_peaks: int = 4,
    separation: float = np.radians(10.0),
    smoothing: float = np.radians(1.0),
) -> tuple[Array, Array]:
    """Rotations ``(m,)`` rad in ``[-π, π)`` that take b's walls to a's, best first, and scores ``(m,)``.

    They are the ``n_peaks`` best local maxima of the circular cross-correlation, at least ``separation`` rad
    apart, each followed by its twin half a turn away (lines do not tell θ from θ+π). With ``smoothing`` > 0
    rad the correlation is blurred by a Gaussian and peaks are placed between bins by a parabola; 0 takes the
    bin itself, as the report does (Formsma, section 3.3).
    """
    correlation = cross_correlation(spectrum_a, spectrum_b)
    n = len(correlation)
    if smoothing > 0.0:
        correlation = _blurred(correlation, smoothing * n / np.pi)
    places = _peaks(correlation, n_peaks, separation * n / np.pi)
    scores = correlation[places]
    bins = places + _vertex(correlation, places) if smoothing > 0.0 else places
    angles = bins * np.pi / n
    return se2.wrap(np.stack([angles, angles + np.pi], -1).ravel()), np.repeat(scores, 2)


def common_directions(
    spectrum_a: Array,
    spectrum_b: Array,
    yaw: float,
    count: int,
    separation: float = np.radians(10.0),
) -> Array:
    """Directions ``(m,)`` rad of lines that both maps have once b is turned by ``yaw``, strongest first.

    They are the ``count`` best local maxima of the product of the spectra, aligned to the bin (Censi 2005),
    that stand out; each is the angle of the lines' normal in a's frame, in ``[0, π)``.
    """
    n = len(spectrum_a)
    product = spectrum_a * np.roll(spectrum_b, round(yaw * n / np.pi))
    places = _peaks(product, count, separation * n / np.pi)
    least = max(FAINTEST * float(product.max()), BACKGROUND * float(np.median(product)))
    return places[product[places] >= least] * np.pi / n


def reason_against_directions(spectrum_a: Array, spectrum_b: Array) -> str | None:
    """Why walls do not fix a pose, in words: a map has no directions, or one only; None where they do.

    Carpin (2008) and Censi (2005) take it for granted that there are two.
    """
    for name, spectrum in (("a", spectrum_a), ("b", spectrum_b)):
        stands_out = gridness(spectrum)
        if not stands_out.trustworthy:
            return f"the walls of submap {name} have no directions (crest {stands_out.crest:.2f})"
        if len(common_directions(spectrum, spectrum, 0.0, 2)) < 2:
            return f"the walls of submap {name} have one direction, along which they are free to slide"
    return None


def _blurred(signal: Array, sigma: float) -> Array:
    """Circular signal ``(n,)`` blurred by a Gaussian of ``sigma`` bins."""
    n = len(signal)
    gain = np.exp(-2.0 * (np.pi * sigma * np.arange(n // 2 + 1) / n) ** 2)
    return np.fft.irfft(np.fft.rfft(signal) * gain, n)


def _peaks(signal: Array, count: int, separation: float) -> np.ndarray:
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


def _vertex(signal: Array, places: np.ndarray) -> Array:
    """Offsets from bins ``places`` to the tops of the parabolas through them and their neighbours."""
    before, at, after = (signal[(places + d) % len(signal)] for d in (-1, 0, 1))
    curvature = before - 2.0 * at + after
    return np.where(curvature < 0.0, 0.5 * (before - after) / np.where(curvature < 0.0, curvature, 1.0), 0.0)
