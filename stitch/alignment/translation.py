"""Translation of one map against another for a known rotation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numba import njit
from scipy.fft import fft, irfft2, next_fast_len, rfft

from slam import se2
from slam.se2 import Array
from stitch.alignment.raster import Raster


def by_spectra(
    points_a: Array, points_b: Array, yaw: float, direction: float, resolution: float
) -> tuple[Array, float]:
    """Translation ``(2,)`` m by X and Y spectra (Formsma, section 3.5; Carpin 2008), and its score.

    Occupied points ``(n, 2)`` of a are turned by ``-direction``, the dominant direction of a's walls, those
    of b by ``yaw - direction``, both about their origins; the counts along each axis are correlated on their
    own. The score is the sum of the two maxima. The thesis's program takes each lag 2 pixels short; that is
    not reproduced.
    """
    turned_a = points_a @ se2.rotation(-direction).T
    turned_b = points_b @ se2.rotation(yaw - direction).T
    best = [lags(turned_a[:, axis], turned_b[:, axis], resolution, 1) for axis in (0, 1)]
    shift = np.array([shifts[0] for shifts, _ in best])
    return se2.rotation(direction) @ shift, float(sum(scores[0] for _, scores in best))


def lags(along_a: Array, along_b: Array, resolution: float, count: int) -> tuple[Array, Array]:
    """Shifts ``(m,)`` m of b that bring its coordinates ``(n,)`` onto a's, best first, and scores ``(m,)``.

    They are the ``count`` best local maxima of `correlation_along`.
    """
    shifts, correlation = correlation_along(along_a, along_b, resolution)
    padded = np.pad(correlation, 1)
    tops = np.flatnonzero((correlation > padded[:-2]) & (correlation >= padded[2:]))
    tops = tops[np.argsort(-correlation[tops], kind="stable")][:count]
    return shifts[tops], correlation[tops]


def correlation_along(along_a: Array, along_b: Array, resolution: float) -> tuple[Array, Array]:
    """Shifts ``(k,)`` m of b at which its coordinates can meet a's, and the correlation ``(k,)`` there."""
    counts_a, first_a = profile(along_a, resolution)
    counts_b, first_b = profile(along_b, resolution)
    correlation = np.correlate(counts_a, counts_b, "full")
    lag = np.arange(len(correlation)) - (len(counts_b) - 1)
    return resolution * (first_a - first_b + lag), correlation


def profile(coordinates: Array, resolution: float) -> tuple[Array, int]:
    """Points per cell along one axis (the thesis's spectrum) and the lattice index of the first cell."""
    cells = np.floor(coordinates / resolution).astype(np.int64)
    first = int(cells.min())
    return np.bincount(cells - first).astype(np.float64), first


LINE = 2.0 * np.sqrt(np.pi)
"""What a cell of a straight wall scores against another such wall, both blurred by one cell."""
BLUR_REACH = 8.0
"""Reach of the blur in its standard deviations: beyond it both maps' blurs vanish in single precision."""


@dataclass(frozen=True)
class Spectra:
    """Fourier transforms ``(4, H, W)`` of a raster, padded to ``shape`` against wrapping: of its walls, its
    free space, and both components of its walls' normals.

    Element 0 is the lattice cell ``first (2,)``; the others are at indices ``low`` to ``high`` (both (column,
    row)), negative ones at the end. Where the map is ``turned`` by half a turn, its transforms are the
    conjugates of those kept, and negated for the normals.
    """

    transforms: np.ndarray
    first: Array
    low: np.ndarray
    high: np.ndarray
    resolution: float
    shape: tuple[int, int]
    turned: bool = False

    def half_turned(self) -> Spectra:
        """Spectra of the map turned by π about the lattice's origin, without drawing it again."""
        return replace(self, first=-self.first - 1.0, low=-self.high, high=-self.low, turned=not self.turned)


@dataclass(frozen=True)
class Correlation:
    """``agreement (h, w)`` and ``conflict (h, w)`` in cells of every shift.

    Element (row, column) is the translation ``first + resolution·(column, row)`` m.
    """

    agreement: np.ndarray
    conflict: np.ndarray
    first: Array
    resolution: float

    def score(self, free_penalty: float) -> np.ndarray:
        """Scores ``(h, w)``: coinciding walls less ``free_penalty`` × walls in free space.

        The penalty is what fixes the translation: without it the largest overlap of clutter wins.
        """
        score = np.float32(-free_penalty) * self.conflict
        score += self.agreement
        return score

    def translations(self) -> Array:
        """The shifts themselves, ``(h, w, 2)`` m."""
        height, width = self.agreement.shape
        x = self.first[0] + self.resolution * np.arange(width)
        y = self.first[1] + self.resolution * np.arange(height)
        return np.stack(np.meshgrid(x, y), -1)


def padded_shape(
    a: Raster, turned: Sequence[Raster], blur: float = 1.0, window: tuple[Array, Array] | None = None
) -> tuple[int, int]:
    """A quick FFT size in which no shift that `correlate` reads with this ``blur`` and ``window`` is wrapped.

    For a with any of the rasters b in ``turned``, as they are or turned by half a turn.
    """
    least = np.max([_least_shape(a, b, blur, window) for b in turned], axis=0)
    width, height = (next_fast_len(int(n), real=True) for n in least)
    return height, width


def _least_shape(a: Raster, b: Raster, blur: float, window: tuple[Array, Array] | None) -> Array:
    """Columns and rows ``(2,)`` that hold both maps and keep wrapped lags out of the window's reach."""
    size_a, size_b = (np.array(raster.occupied.shape[::-1]) for raster in (a, b))
    lags = size_a + size_b - 1
    if window is None:
        return lags
    least, reach = np.maximum(size_a, size_b), np.ceil(BLUR_REACH * blur) + 1.0
    for first, lowest in (
        (b.first, 1 - size_b),
        (-b.first - 1.0, np.zeros(2)),
    ):  # as it is, turned by half a turn
        highest, offset = lowest + lags - 1, a.first - first
        low = np.maximum(lowest, np.floor(window[0] / a.resolution - offset))
        high = np.minimum(highest, np.ceil(window[1] / a.resolution - offset))
        least = np.maximum(least, np.maximum(highest - low, high - lowest) + reach)
    return np.minimum(least, lags)


def spectra(raster: Raster, shape: tuple[int, int], out: np.ndarray | None = None) -> Spectra:
    """Transforms of a raster for `correlate`; single precision, as counts need no more.

    They are written to ``out (4, H, W // 2 + 1)`` complex64 where it is given.
    """
    height, width = raster.occupied.shape
    facing = (None, None) if raster.facing is None else raster.facing
    transforms = np.empty((4, *transform_shape(shape)), dtype=np.complex64) if out is None else out
    # what rfft2 does, without transforming the padding's rows, which are zero
    for layer, transform in zip((raster.walls, raster.free, *facing), transforms, strict=True):
        if layer is None:
            transform[:] = 0.0
            continue
        transform[height:] = 0.0
        transform[:height] = rfft(layer.astype(np.float32, copy=False), shape[1], workers=1)
        transform[:] = fft(transform, axis=0, overwrite_x=True, workers=1)
    high = np.array([width - 1, height - 1])
    return Spectra(transforms, raster.first, np.zeros(2, dtype=int), high, raster.resolution, shape)


def transform_shape(shape: tuple[int, int]) -> tuple[int, int]:
    """Rows and columns of the transform of a real picture of ``shape``."""
    return shape[0], shape[1] // 2 + 1


def correlate(
    a: Spectra,
    b: Spectra,
    blur: float = 1.0,
    window: tuple[Array, Array] | None = None,
    facing_share: float = 0.5,
) -> Correlation:
    """How well two maps fit at all translations of b.

    Agreement counts coinciding walls, blurred by ``blur`` cells on both sides and scaled so that one
    coinciding cell counts 1 (a cell of a straight wall also collects its neighbours' blur, `LINE` in all
    for a blur of 1). Of that, ``facing_share`` is times the cosine between the walls' normals, which is 0
    where either is unknown. Conflict counts walls in the other's free space. ``window`` = (low (2,), high
    (2,)) m limits the answer to some translations. Raises ``ValueError`` for spectra of different
    shape, or a turned.
    """
    if a.shape != b.shape:
        raise ValueError(f"spectra of different shape: {a.shape} and {b.shape}")
    if a.turned:
        raise ValueError("spectra of a are turned: expected only those of b to be")
    gain = _blur_gain(a.shape, blur)
    products = multiply_spectra(a.transforms, b.transforms, gain, facing_share, b.turned)
    offset = a.first - b.first
    low, high = a.low - b.high, a.high - b.low
    if window is not None:
        low = np.maximum(low, np.floor(window[0] / a.resolution - offset)).astype(int)
        high = np.minimum(high, np.ceil(window[1] / a.resolution - offset)).astype(int)
    width, height = np.maximum(high - low + 1, 0)
    agreement, conflict = (  # negative lags sit at the end
        np.roll(irfft2(product, s=a.shape, workers=1), (-low[1], -low[0]), axis=(0, 1))[:height, :width]
        for product in products
    )
    return Correlation(agreement, conflict, a.resolution * (offset + low), a.resolution)


@njit(cache=True)
def multiply_spectra(a: np.ndarray, b: np.ndarray, gain: np.ndarray, alike: float, turned: bool = False
                     ) -> np.ndarray:  # fmt: skip
    """Transforms ``(2, H, W)`` of agreement and conflict from those of two maps ``(4, H, W)``: walls, free
    space, and the two components of the walls' normals.

    ``gain (H, W)`` is the blur's; ``alike`` the share of the agreement that depends on facing the same way.
    ``turned``: b is turned by half a turn, which conjugates its transforms and negates its normals.
    """
    out = np.empty(a[:2].shape, dtype=np.complex64)
    agreement, conflict = out[0].ravel(), out[1].ravel()
    walls_a, free_a, x_a, y_a = a[0].ravel(), a[1].ravel(), a[2].ravel(), a[3].ravel()
    walls_b, free_b, x_b, y_b = b[0].ravel(), b[1].ravel(), b[2].ravel(), b[3].ravel()
    flat, one, other = gain.ravel(), np.float32(1.0 - alike), np.float32(alike)
    for i in range(flat.size):
        k = np.uint64(i)
        if turned:
            walls, free, x, y = walls_b[k], free_b[k], -x_b[k], -y_b[k]
        else:
            walls, free, x, y = np.conj(walls_b[k]), np.conj(free_b[k]), np.conj(x_b[k]), np.conj(y_b[k])
        facing = x_a[k] * x + y_a[k] * y
        agreement[k] = flat[k] * (one * walls_a[k] * walls + other * facing)
        conflict[k] = free_a[k] * walls + walls_a[k] * free
    return out


@lru_cache(maxsize=2)
def _blur_gain(shape: tuple[int, int], blur: float) -> np.ndarray:
    """Fourier transform of two Gaussians of ``blur`` cells, one after the other, worth 1 in the middle."""
    squared = 2.0 * blur**2
    rows, columns = (
        np.exp(-2.0 * np.pi**2 * squared * frequency**2).astype(np.float32)
        for frequency in (np.fft.fftfreq(shape[0]), np.fft.rfftfreq(shape[1]))
    )
    scale = 2.0 * np.pi * squared if blur > 0.0 else 1.0
    return np.float32(scale) * np.outer(rows, columns)


def best_shifts(score: np.ndarray, count: int, separation: int) -> list[tuple[int, int]]:
    """(row, column) of the best finite scores, strongest first, more than ``separation`` cells apart."""
    left = score.copy()
    best: list[tuple[int, int]] = []
    while len(best) < count and left.size:
        row, column = np.unravel_index(int(np.argmax(left)), left.shape)
        if not np.isfinite(left[row, column]):
            break
        best.append((int(row), int(column)))
        rows = slice(max(row - separation, 0), row + separation + 1)
        columns = slice(max(column - separation, 0), column + separation + 1)
        left[rows, columns] = -np.inf
    return best
