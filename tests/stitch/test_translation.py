"""Translations for a known rotation."""

from __future__ import annotations

import numpy as np
import pytest

from slam import se2
from stitch.raster import Raster
from stitch.translation import LINE, best_shifts, by_spectra, correlate, padded_shape, spectra


def raster(occupied: np.ndarray, free: np.ndarray | None = None, first: tuple[int, int] = (0, 0)) -> Raster:
    free = np.zeros_like(occupied) if free is None else free
    return Raster(occupied, free, np.array(first, dtype=float), 0.5)


def correlation(a: Raster, b: Raster, **options):
    shape = padded_shape(a, max(b.occupied.shape))
    return correlate(spectra(a, shape), spectra(b, shape), **options)


def best_translation(found, free_penalty: float) -> np.ndarray:
    score = found.score(free_penalty)
    row, column = np.unravel_index(np.argmax(score), score.shape)
    return found.translations()[row, column]


def slow_score(a: Raster, b: Raster, lag: tuple[int, int], penalty: float) -> tuple[float, float]:
    """Score without blur, and overlap in cells, cell by cell."""
    score = overlap = 0.0
    for row, column in np.ndindex(b.occupied.shape):
        i, j = row + lag[1], column + lag[0]
        if 0 <= i < a.occupied.shape[0] and 0 <= j < a.occupied.shape[1]:
            score += a.occupied[i, j] & b.occupied[row, column]
            score -= penalty * (a.occupied[i, j] & b.free[row, column])
            score -= penalty * (a.free[i, j] & b.occupied[row, column])
            overlap += (a.occupied | a.free)[i, j] & (b.occupied | b.free)[row, column]
    return score, overlap


def random_raster(rng: np.random.Generator, shape: tuple[int, int], first: tuple[int, int]) -> Raster:
    kind = rng.integers(0, 3, shape)
    return raster(kind == 1, kind == 2, first)


def test_correlation_agrees_with_the_slow_twin_at_every_shift() -> None:
    """Also proves the padding: an FFT that wraps would add shifts together."""
    rng = np.random.default_rng(0)
    a, b = random_raster(rng, (7, 5), (-3, 2)), random_raster(rng, (4, 6), (1, -9))
    found = correlation(a, b, blur=0.0)
    found_score = found.score(2.5)
    assert found_score.shape == (7 + 4 - 1, 5 + 6 - 1)
    for row, column in np.ndindex(found_score.shape):
        lag = (column - 5, row - 3)
        score, overlap = slow_score(a, b, lag, 2.5)
        assert found_score[row, column] == pytest.approx(score, abs=1e-3)
        assert found.overlap[row, column] == pytest.approx(overlap * 0.25, abs=1e-3)
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
    a = Raster(np.array([[True, True]]), np.zeros((1, 2), bool), np.zeros(2), 0.5, np.float32([[1.0, 0.5]]))
    b = Raster(np.array([[True]]), np.zeros((1, 1), bool), np.zeros(2), 0.5, np.float32([[0.4]]))
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


def test_spectra_of_different_padding_are_refused() -> None:
    one = raster(np.ones((3, 3), bool))
    with pytest.raises(ValueError, match="different shape"):
        correlate(spectra(one, (8, 8)), spectra(one, (9, 8)))


def test_best_shifts_are_distinct_and_positive() -> None:
    score = np.zeros((20, 20))
    score[5, 5], score[5, 6], score[15, 10] = 3.0, 2.9, 1.0
    assert best_shifts(score, 5, 2) == [(5, 5), (15, 10)]


def test_best_shifts_of_an_empty_window() -> None:
    assert best_shifts(np.zeros((0, 4)), 3, 1) == []


@pytest.mark.parametrize("yaw", [0.0, 0.7, -2.0])
@pytest.mark.parametrize("direction", [0.0, 0.4])
def test_x_and_y_spectra_find_a_full_overlap(yaw: float, direction: float) -> None:
    """An L of walls along ``direction`` in a; no 2-pixel lag as in the report's program."""
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
