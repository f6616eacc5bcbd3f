"""All rotations and shifts of two maps that may be bent, both ways, by FFT: walls that face the same way
within a wide reach, and a bounded loss for what stands deep in the other's free space."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from scipy.fft import irfft2, next_fast_len, rfft2

from slam import se2
from slam.se2 import Array
from stitch.alignment.candidates import distinct
from stitch.alignment.config import TolerantConfig
from stitch.alignment.facing import CELL, UNKNOWN, FacingWalls
from stitch.alignment.result import Alternative

BINS = 90
"""Directions of the histogram of walls, over half a turn; also the rotations that are tried."""
COARSE = 2
"""Cells of the walls' lattice along a side of one of the search."""
STEP = COARSE * CELL
"""Side of a cell of the search [m]."""
CHANNELS = np.array([0.25, 0.5, 0.5, 0.25, 0.25], dtype=np.float32)
"""``¼ + ½ cos Δφ + ¼ cos 2Δφ`` as products of 1, cos φ, sin φ, cos 2φ, sin 2φ of either wall."""
HALF_TURN = np.array([1.0, -1.0, -1.0, 1.0, 1.0], dtype=np.float32)
"""What turning by π does to them."""


@dataclass(frozen=True)
class Searched:
    """A map on the search's lattice, which repeats itself: ``transforms (5, N, N // 2 + 1)`` of its field of
    agreement less conflict about the middle of its walls."""

    walls: FacingWalls
    transforms: np.ndarray

    @classmethod
    def of(cls, walls: FacingWalls, side: int, config: TolerantConfig) -> Searched:
        """The map on a lattice of ``side`` cells."""
        field, corner = agreement_field(walls, config)
        out = np.zeros((len(CHANNELS), side, side), dtype=np.float32)
        resample(field, (corner - walls.middle) / STEP, out)
        return cls(walls, rfft2(out, workers=1))


def agreement_field(walls: FacingWalls, config: TolerantConfig) -> tuple[np.ndarray, Array]:
    """What a wall point of another map meets anywhere, in the five `CHANNELS` ``(5, H, W)`` float32 on cells
    of `STEP`, and the centre ``(2,)`` m of the first of them."""
    height, width = walls.distance.shape
    field = np.zeros((len(CHANNELS), height, width), dtype=np.float32)
    _fill(walls.points, walls.angles, walls.nearest, walls.corner, config.width, field)
    field *= CHANNELS[:, None, None]
    deep = np.clip((walls.distance - config.width) / config.width, 0.0, 1.0)
    field[0] -= config.conflict * np.where(walls.free, deep, 0.0).astype(np.float32)
    rows, columns = height // COARSE, width // COARSE
    blocks = field[:, : rows * COARSE, : columns * COARSE].reshape(len(CHANNELS), rows, COARSE, columns, -1)
    return blocks.mean(axis=(2, 4)), walls.corner + 0.5 * STEP


@njit(cache=True)
def _add_facing(field, row, column, amount, angle):
    """Add an amount of wall that faces ``angle`` rad to all channels but the first of a cell."""
    c, s = np.cos(angle), np.sin(angle)
    field[1, row, column] += amount * c
    field[2, row, column] += amount * s
    field[3, row, column] += amount * (c * c - s * s)
    field[4, row, column] += amount * 2.0 * c * s


@njit(cache=True)
def _fill(points, angles, nearest, corner, width, field):
    """Add to ``field (5, H, W)`` what each class of facing gives."""
    for k in range(nearest.shape[0]):
        for i in range(nearest.shape[1]):
            y = corner[1] + (i + 0.5) * CELL
            for j in range(nearest.shape[2]):
                p = nearest[k, i, j]
                if p < 0:
                    continue
                x = corner[0] + (j + 0.5) * CELL
                dx, dy = points[p, 0] - x, points[p, 1] - y
                near = np.exp(-0.5 * (dx * dx + dy * dy) / (width * width))
                field[0, i, j] += near
                if k < UNKNOWN:
                    _add_facing(field, i, j, near, angles[p])


@njit(cache=True)
def resample(field, first, out):
    """Write ``field (5, h, w)``, whose first cell lies at ``first (2,)`` cells, onto the cells of the
    periodic ``out (5, N, N)``, between four of its own."""
    side = out.shape[1]
    x0, y0 = int(np.ceil(first[0])), int(np.ceil(first[1]))
    fx, fy = x0 - first[0], y0 - first[1]
    for k in range(field.shape[0]):
        for i in range(field.shape[1] - 1):
            for j in range(field.shape[2] - 1):
                low = (1.0 - fx) * field[k, i, j] + fx * field[k, i, j + 1]
                high = (1.0 - fx) * field[k, i + 1, j] + fx * field[k, i + 1, j + 1]
                out[k, (y0 + i) % side, (x0 + j) % side] = (1.0 - fy) * low + fy * high


@njit(cache=True)
def splat(points, angles, known, weights, turn, out):
    """Add wall points ``(n, 2)`` m, turned by ``turn`` rad, to the periodic ``out (5, N, N)``."""
    side = out.shape[1]
    out[:] = 0.0
    ct, st = np.cos(turn), np.sin(turn)
    for p in range(len(points)):
        x = (ct * points[p, 0] - st * points[p, 1]) / STEP
        y = (st * points[p, 0] + ct * points[p, 1]) / STEP
        j, i = int(np.floor(x)), int(np.floor(y))
        fx, fy = x - j, y - i
        for di in range(2):
            for dj in range(2):
                share = weights[p] * (fy if di else 1.0 - fy) * (fx if dj else 1.0 - fx)
                row, column = (i + di) % side, (j + dj) % side
                out[0, row, column] += share
                if known[p]:
                    _add_facing(out, row, column, share, angles[p] + turn)


@njit(cache=True)
def products(field, walls, signs):
    """Transforms ``(2, N, M)`` of the correlation of a field with walls, as they are and turned by π."""
    _, height, width = field.shape
    out = np.zeros((2, height, width), dtype=np.complex64)
    for k in range(field.shape[0]):
        for i in range(height):
            for j in range(width):
                out[0, i, j] += field[k, i, j] * np.conj(walls[k, i, j])
                out[1, i, j] += signs[k] * field[k, i, j] * walls[k, i, j]
    return out


@njit(cache=True)
def add_turned(score, other, turn):
    """Add to ``score (N, N)``, by shift t of b in a, ``other (N, N)``, by the shift −R(−turn) t of a in b."""
    side = score.shape[0]
    half = side // 2
    c, s = np.cos(turn), np.sin(turn)
    for i in range(side):
        y = i if i < half else i - side
        for j in range(side):
            x = j if j < half else j - side
            u, v = -(c * x + s * y), -(-s * x + c * y)
            column, row = int(np.floor(u)), int(np.floor(v))
            if abs(u) > half or abs(v) > half:
                continue
            fx, fy = u - column, v - row
            r0, r1, c0, c1 = row % side, (row + 1) % side, column % side, (column + 1) % side
            score[i, j] += np.float32(
                (1.0 - fy) * ((1.0 - fx) * other[r0, c0] + fx * other[r0, c1])
                + fy * ((1.0 - fx) * other[r1, c0] + fx * other[r1, c1])
            )


@njit(cache=True)
def peaks(score, count):
    """The highest ``count`` local maxima of the periodic ``score (N, N)``: ``(count, 3)`` of score, row and
    column; −inf where there are fewer."""
    side = score.shape[0]
    best = np.full((count, 3), -np.inf)
    for i in range(side):
        for j in range(side):
            value = score[i, j]
            if value <= best[count - 1, 0]:
                continue
            highest = True
            for di in range(-1, 2):
                for dj in range(-1, 2):
                    if score[(i + di) % side, (j + dj) % side] > value:
                        highest = False
            if not highest:
                continue
            k = count - 1
            while k > 0 and best[k - 1, 0] < value:
                best[k] = best[k - 1]
                k -= 1
            best[k, 0], best[k, 1], best[k, 2] = value, i, j
    return best


def rotations(a: FacingWalls, b: FacingWalls, least: float) -> Array:
    """Rotations ``(m,)`` rad of b, each within half a turn, at which the directions of the walls agree at
    least ``least`` as well as at the best."""
    spectra = []
    for walls in (a, b):
        known = walls.known
        bins = np.round(walls.angles[known] * BINS / np.pi).astype(np.int64) % BINS
        histogram = np.bincount(bins, walls.weights[known], minlength=BINS)
        spectra.append(np.fft.rfft(histogram + 0.5 * (np.roll(histogram, 1) + np.roll(histogram, -1))))
    agreement = np.fft.irfft(spectra[0] * np.conj(spectra[1]), BINS)
    return np.flatnonzero(agreement >= least * agreement.max()) * np.pi / BINS


def search(a: FacingWalls, b: FacingWalls, config: TolerantConfig) -> list[Alternative]:
    """The best alignments of b in a, none near a better one, best first; scores are in metres of wall."""
    sizes = [np.ptp(walls.points, axis=0) for walls in (a, b)]
    side = next_fast_len(int(np.ceil(sum(np.hypot(*size) for size in sizes) / STEP)) + 8, real=True)
    side += side % 2
    in_a, in_b = (Searched.of(walls, side, config) for walls in (a, b))
    memory = np.empty((len(CHANNELS), side, side), dtype=np.float32)
    found = []
    for turn in rotations(a, b, config.min_rotation):
        scores = _correlate(in_a, in_b, turn, memory)
        others = _correlate(in_b, in_a, -turn, memory)
        for score, other, yaw in zip(scores, others, (turn, turn - np.pi), strict=True):
            add_turned(score, other, yaw)
            for value, row, column in peaks(score, config.peaks):
                if not np.isfinite(value):
                    break
                shift = (np.array([column, row]) + 0.5 * side) % side - 0.5 * side
                t = a.middle + STEP * shift - se2.rotation(yaw) @ b.middle
                found.append(Alternative(np.array([*t, se2.wrap(yaw)]), float(value)))
    found.sort(key=lambda one: -one.score)
    poses = np.array([one.T_a_b for one in found]).reshape(-1, 3)
    return [found[i] for i in distinct(poses, b.middle, config.separation, config.candidates)]


def _correlate(of: Searched, other: Searched, turn: float, memory: np.ndarray) -> np.ndarray:
    """Scores ``(2, N, N)`` of all shifts of the other's walls, turned by ``turn`` and by half a turn more, in
    the field of a map."""
    walls = other.walls
    splat(walls.points - walls.middle, walls.angles, walls.known, walls.weights, turn, memory)
    both = products(of.transforms, rfft2(memory, workers=1), HALF_TURN)
    scores: np.ndarray = irfft2(both, s=memory.shape[1:], workers=1)
    return scores
