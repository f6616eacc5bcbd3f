"""Translations for a known rotation."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.fft import rfft2

from slam import se2
from slam.mapping.occupancy import Grid
from stitch.alignment.raster import Raster, rasterise
from stitch.alignment.translation import (
    LINE,
    Spectra,
    best_shifts,
    by_spectra,
    correlate,
    multiply_spectra,
    padded_shape,
    spectra,
    transform_shape,
)


def raster(
    occupied: np.ndarray,
    free: np.ndarray | None = None,
    first: tuple[int, int] = (0, 0),
    facing: tuple[float, float] | None = (0.6, 0.8),
    weight: np.ndarray | None = None,
) -> Raster:
    """Cells of 0.5 m whose walls all face one way, or unknown ways."""
    free = np.zeros_like(occupied) if free is None else free
    weight = occupied.astype(np.float32) if weight is None else weight
    faced = None if facing is None else (weight * np.array(facing)[:, None, None]).astype(np.float32)
    return Raster(occupied, free, np.array(first, dtype=float), 0.5, weight, faced)


def correlation(a: Raster, b: Raster, **options):
    shape = padded_shape(a, [b])
    return correlate(spectra(a, shape), spectra(b, shape), **options)


def best_translation(found, free_penalty: float) -> np.ndarray:
    score = found.score(free_penalty)
    row, column = np.unravel_index(np.argmax(score), score.shape)
    return found.translations()[row, column]


def slow_score(a: Raster, b: Raster, lag: tuple[int, int], penalty: float) -> float:
    """Score without blur, cell by cell."""
    score = 0.0
    for row, column in np.ndindex(b.occupied.shape):
        i, j = row + lag[1], column + lag[0]
        if 0 <= i < a.occupied.shape[0] and 0 <= j < a.occupied.shape[1]:
            alike = 0.5 + 0.5 * (a.facing[:, i, j] @ b.facing[:, row, column])
            score += alike * (a.occupied[i, j] & b.occupied[row, column])
            score -= penalty * (a.occupied[i, j] & b.free[row, column])
            score -= penalty * (a.free[i, j] & b.occupied[row, column])
    return score


def random_raster(rng: np.random.Generator, shape: tuple[int, int], first: tuple[int, int]) -> Raster:
    """Walls, free space and unknown cells, mixed; each wall faces a way of its own."""
    kind, angle = rng.integers(0, 3, shape), rng.uniform(-np.pi, np.pi, shape)
    facing = ((kind == 1) * np.stack([np.cos(angle), np.sin(angle)])).astype(np.float32)
    return replace(raster(kind == 1, kind == 2, first), facing=facing)


def test_correlation_agrees_with_the_slow_twin_at_every_shift() -> None:
    """Also proves the padding: an FFT that wraps would add shifts together."""
    rng = np.random.default_rng(0)
    a, b = random_raster(rng, (7, 5), (-3, 2)), random_raster(rng, (4, 6), (1, -9))
    found = correlation(a, b, blur=0.0)
    found_score = found.score(2.5)
    assert found_score.shape == (7 + 4 - 1, 5 + 6 - 1)
    for row, column in np.ndindex(found_score.shape):
        lag = (column - 5, row - 3)
        assert found_score[row, column] == pytest.approx(slow_score(a, b, lag, 2.5), abs=1e-3)
        expected = 0.5 * (np.array(lag) + np.array([-3 - 1, 2 + 9]))
        np.testing.assert_allclose(found.translations()[row, column], expected)


def test_a_blurred_coinciding_cell_scores_one() -> None:
    one = np.zeros((9, 9), bool)
    one[4, 4] = True
    found = correlation(raster(one), raster(one), blur=1.0)
    middle = np.array(found.agreement.shape) // 2
    assert found.agreement[tuple(middle)] == pytest.approx(1.0, abs=1e-4)
    assert found.agreement[middle[0], middle[1] + 1] == pytest.approx(np.exp(-0.25), abs=1e-3)


def test_a_cell_of_a_straight_wall_collects_its_neighbours() -> None:
    wall = np.zeros((9, 60), bool)
    wall[4, 10:50] = True
    found = correlation(raster(wall), raster(wall), blur=1.0)
    ends = 2.0  # cells at both ends have neighbours on one side only
    assert found.agreement.max() == pytest.approx(LINE * 40, rel=ends / 40)


def test_weights_count_on_both_sides() -> None:
    """A heavy and a light cell: products where walls meet, weights where a wall meets free space."""
    a = raster(np.array([[True, True]]), weight=np.float32([[1.0, 0.5]]))
    b = raster(np.array([[True]]), weight=np.float32([[0.4]]))
    np.testing.assert_allclose(correlation(a, b, blur=0.0).agreement[0], [0.4, 0.2], atol=1e-6)
    open_floor = raster(np.zeros((1, 1), bool), np.ones((1, 1), bool))
    np.testing.assert_allclose(correlation(a, open_floor, blur=0.0).conflict[0], [1.0, 0.5], atol=1e-6)


def test_the_window_is_a_part_of_the_whole() -> None:
    rng = np.random.default_rng(1)
    a, b = random_raster(rng, (12, 14), (3, -4)), random_raster(rng, (9, 8), (-2, 6))
    whole = correlation(a, b)
    low, high = np.array([0.6, -6.0]), np.array([3.1, -4.2])
    part = correlation(a, b, window=(low, high))
    t = part.translations()
    assert np.all(t.reshape(-1, 2).min(axis=0) <= low)
    assert np.all(t.reshape(-1, 2).max(axis=0) >= high)
    column, row = np.round((t[0, 0] - whole.first) / 0.5).astype(int)
    height, width = part.agreement.shape
    expected = whole.score(5.0)[row : row + height, column : column + width]
    np.testing.assert_allclose(part.score(5.0), expected, atol=1e-3)


def test_free_space_fixes_what_walls_alone_get_wrong() -> None:
    """b is a short wall seen with the open floor beyond its end; a has a longer, thicker one next door."""
    walls, free = np.zeros((12, 40), bool), np.zeros((12, 40), bool)
    walls[5, 3:9] = True  # the true one: six cells, open on both sides
    free[3:8, 0:15] = True
    walls[5:7, 20:38] = True  # rubble that swallows anything
    seen, around = np.zeros((5, 12), bool), np.zeros((5, 12), bool)
    seen[2, 3:9] = True
    around[:] = True
    a, b = raster(walls, free & ~walls), raster(seen, around & ~seen)
    truth = np.array([0.0, 1.5])
    assert np.linalg.norm(best_translation(correlation(a, b), 0.0) - truth) > 5.0
    np.testing.assert_allclose(best_translation(correlation(a, b), 5.0), truth)


@pytest.mark.parametrize(("facing", "share"), [((0.0, 1.0), 1.0), ((0.0, -1.0), 0.0), (None, 0.5)])
def test_walls_seen_from_opposite_sides_do_not_agree(
    facing: tuple[float, float] | None, share: float
) -> None:
    """Half the agreement is left where nobody knows."""
    wall = np.zeros((9, 60), bool)
    wall[4, 10:50] = True
    a, b = raster(wall, facing=(0.0, 1.0)), raster(wall, facing=facing)
    assert correlation(a, b).agreement.max() == pytest.approx(share * LINE * 40, rel=0.05, abs=0.1)


def test_a_window_needs_less_room_for_the_same_answer() -> None:
    """Only the shifts that are read must be kept apart from those that fold onto them, blur and all."""
    rng = np.random.default_rng(3)
    a, b = random_raster(rng, (90, 110), (4, -6)), random_raster(rng, (80, 70), (-30, 9))
    full = padded_shape(a, [b])
    rooms = []
    for centre in rng.uniform(-15.0, 15.0, (8, 2)):
        window = centre - 2.0, centre + rng.uniform(0.0, 6.0, 2)
        rooms.append(padded_shape(a, [b], window=window))
        for turned in (lambda of: of, Spectra.half_turned):
            found, expected = (
                correlate(spectra(a, shape), turned(spectra(b, shape)), window=window)
                for shape in (rooms[-1], full)
            )
            np.testing.assert_allclose(found.agreement, expected.agreement, atol=2e-3)
            np.testing.assert_allclose(found.conflict, expected.conflict, atol=2e-3)
    assert min(height * width for height, width in rooms) < 0.75 * full[0] * full[1]


@pytest.mark.parametrize("window", [None, (np.array([-2.0, 1.0]), np.array([3.0, 4.5]))])
def test_a_half_turn_is_that_of_the_map_itself(window: tuple[np.ndarray, np.ndarray] | None) -> None:
    """Spectra turned by π against those of a map really turned by π: the same at every shift."""
    rng = np.random.default_rng(2)
    points, angle = rng.uniform([-1.4, 2.1], [2.5, 4.5], (30, 2)), rng.uniform(-np.pi, np.pi, 30)
    points = points[np.unique(np.floor(points / 0.5), axis=0, return_index=True)[1]]  # one in a cell
    normals = np.stack([np.cos(angle), np.sin(angle)], -1)[: len(points)]
    weights = rng.uniform(0.1, 1.0, len(points))
    grid = Grid(np.zeros((5, 8), bool), rng.uniform(size=(5, 8)) < 0.7, np.array([-1.4, 2.1]), 0.5)
    a = random_raster(rng, (9, 13), (4, -6))
    upright, turned = (
        rasterise(points, grid, np.array([0.0, 0.0, yaw]), 0.5, weights, normals) for yaw in (0.0, np.pi)
    )
    shape = padded_shape(a, [upright], window=window)
    found, expected = (
        correlate(spectra(a, shape), b, window=window)
        for b in (spectra(upright, shape).half_turned(), spectra(turned, shape))
    )
    np.testing.assert_allclose(found.agreement, expected.agreement, atol=1e-4)
    np.testing.assert_allclose(found.conflict, expected.conflict, atol=1e-4)
    np.testing.assert_allclose(found.first, expected.first)
    assert found.agreement.max() > 1.0
    assert found.conflict.max() > 1.0


def test_products_of_transforms_are_those_of_numpy() -> None:
    rng = np.random.default_rng(3)
    a, b = (
        (rng.normal(size=(4, 6, 5)) + 1j * rng.normal(size=(4, 6, 5))).astype(np.complex64) for _ in range(2)
    )
    gain = rng.uniform(size=(6, 5)).astype(np.float32)
    found = multiply_spectra(a, b, gain, 0.3)
    crossed = a * np.conj(b)
    agreement = gain * (0.7 * crossed[0] + 0.3 * (crossed[2] + crossed[3]))
    conflict = a[1] * np.conj(b[0]) + a[0] * np.conj(b[1])
    assert found.dtype == np.complex64
    np.testing.assert_allclose(found, [agreement, conflict], rtol=1e-4, atol=1e-5)
    half_turned = np.conj(b) * np.array([1.0, 1.0, -1.0, -1.0], dtype=np.float32)[:, None, None]
    found = multiply_spectra(a, b, gain, 0.3, True)
    np.testing.assert_allclose(found, multiply_spectra(a, half_turned, gain, 0.3), rtol=1e-4, atol=1e-5)


def test_spectra_are_those_of_scipy() -> None:
    """With and without what walls face; written where they are asked to, whatever was there."""
    a = random_raster(np.random.default_rng(4), (7, 5), (0, 0))
    layers = np.stack([a.walls, a.free.astype(np.float32), *a.facing])
    room = np.full((4, *transform_shape((12, 9))), 7.0, dtype=np.complex64)
    for one, transformed in ((a, layers), (replace(a, facing=None), layers * [[[1]], [[1]], [[0]], [[0]]])):
        found = spectra(one, (12, 9), room)
        assert found.transforms is room
        np.testing.assert_allclose(found.transforms, rfft2(transformed, s=(12, 9)), atol=1e-4)
        np.testing.assert_array_equal(spectra(one, (12, 9)).transforms, room)


def test_only_b_is_turned() -> None:
    one = spectra(raster(np.ones((3, 3), bool)), (8, 8))
    with pytest.raises(ValueError, match="turned"):
        correlate(one.half_turned(), one)
    np.testing.assert_array_equal(
        correlate(one, one.half_turned().half_turned()).agreement, correlate(one, one).agreement
    )


@pytest.mark.parametrize(
    "window", [((9.0, 9.0), (12.0, 12.0)), ((-12.0, -1.0), (-9.0, 1.0)), ((-1.0, 0.5), (-0.5, 1.0))]
)
def test_a_window_beside_the_maps_and_within_one_sign(window: tuple[tuple[float, float], ...]) -> None:
    """Nothing beyond the last shift; only negative lags, only positive ones."""
    one = raster(np.ones((5, 5), bool))
    whole, part = correlation(one, one), correlation(one, one, window=tuple(map(np.array, window)))
    if part.agreement.size:
        column, row = np.round((part.first - whole.first) / 0.5).astype(int)
        height, width = part.agreement.shape
        np.testing.assert_array_equal(
            part.agreement, whole.agreement[row : row + height, column : column + width]
        )
    assert (part.agreement.size == 0) == (abs(window[0][0]) >= 9.0)


def test_spectra_of_different_padding_are_refused() -> None:
    one = raster(np.ones((3, 3), bool))
    with pytest.raises(ValueError, match="different shape"):
        correlate(spectra(one, (8, 8)), spectra(one, (9, 8)))


def test_best_shifts_are_distinct_and_finite() -> None:
    """A score below zero counts as well: the judge may still prefer it."""
    score = np.full((20, 20), -np.inf)
    score[5, 5], score[5, 6], score[15, 10], score[0, 19] = 3.0, 2.9, -1.0, -7.0
    assert best_shifts(score, 5, 2) == [(5, 5), (15, 10), (0, 19)]
    assert best_shifts(score, 2, 2) == [(5, 5), (15, 10)]


def test_best_shifts_of_an_empty_window() -> None:
    assert best_shifts(np.zeros((0, 4)), 3, 1) == []


@pytest.mark.parametrize("yaw", [0.0, 0.7, -2.0])
@pytest.mark.parametrize("direction", [0.0, 0.4])
def test_x_and_y_spectra_find_a_full_overlap(yaw: float, direction: float) -> None:
    """An L of walls along ``direction`` in a; no 2-pixel lag as in the thesis's program."""
    along = np.arange(0.0, 6.0, 0.05)
    local = np.concatenate(
        [np.stack([along, 0 * along], -1), np.stack([0 * along[:80], along[:80]], -1), [[3.0, 2.0]] * 9]
    )
    a = local @ se2.rotation(direction).T + [4.0, -7.0]
    T_a_b = np.array([-3.2, 5.4, yaw])
    b = se2.transform(se2.inverse(T_a_b), a)
    t, score = by_spectra(a, b, yaw, direction, 0.05)
    np.testing.assert_allclose(t, T_a_b[:2], atol=0.08)
    assert score > 0.0
