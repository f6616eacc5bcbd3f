"""Lines vote for their direction."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from slam import se2
from stitch.alignment import hough
from stitch.alignment.config import DirectionConfig
from stitch.alignment.hough import cross_correlation, hypotheses, peaks


def line(angle: float, rho: float, n: int = 200) -> np.ndarray:
    """Points on the line x cos + y sin = rho."""
    along = np.linspace(-4.0, 4.0, n)[:, None]
    normal = np.array([np.cos(angle), np.sin(angle)])
    return rho * normal + along * np.array([-normal[1], normal[0]])


def slow_votes(points: np.ndarray, n_theta: int, first: float, resolution: float, n_rho: int) -> np.ndarray:
    """A bin gets what is left of each vote after its distance to the bin, in bins."""
    theta = np.arange(n_theta) * np.pi / n_theta
    rho = points[:, :1] * np.cos(theta) + points[:, 1:] * np.sin(theta)
    centres = first + resolution * np.arange(n_rho)
    return np.clip(1.0 - np.abs(rho[:, :, None] - centres) / resolution, 0.0, None).sum(axis=0)


def test_kernel_agrees_with_its_slow_twin() -> None:
    points = np.random.default_rng(0).normal(0.0, 3.0, (50, 2))
    fast = hough.transform(points, 36, 0.1)
    slow = slow_votes(points, 36, fast.first, fast.resolution, fast.votes.shape[1])
    np.testing.assert_allclose(fast.votes, slow, atol=1e-9)


@pytest.mark.parametrize(("count", "spread"), [(3, 40.0), (50, 3.0), (3000, 8.0)])
def test_a_spectrum_without_its_votes_is_the_same(count: int, spread: float) -> None:
    """Also of few points far apart: many bins that hold little."""
    points = np.random.default_rng(2).normal(0.0, spread, (count, 2))
    slow = hough.spectrum(hough.transform(points, 90, 0.1))
    np.testing.assert_allclose(hough.spectrum_of(points, 90, 0.1), slow, rtol=0.0, atol=1e-9)


def test_the_spectrum_of_nothing_is_zero() -> None:
    np.testing.assert_array_equal(hough.spectrum_of(np.zeros((0, 2)), 8, 0.1), np.zeros(8))


def test_whole_votes_agree_with_counting() -> None:
    points = np.random.default_rng(0).normal(0.0, 3.0, (50, 2))
    found = hough.transform(points, 36, 0.1, split=False)
    centres = found.first + 0.1 * np.arange(found.votes.shape[1])
    for k, theta in enumerate(np.arange(36) * np.pi / 36):
        rho = points @ [np.cos(theta), np.sin(theta)]
        slow = [np.sum((rho > c - 0.05) & (rho <= c + 0.05)) for c in centres]
        np.testing.assert_array_equal(found.votes[k], slow)


@pytest.mark.parametrize("split", [True, False])
def test_a_wall_along_the_grid_is_in_one_bin(split: bool) -> None:
    """Centres of cells lie half a cell off the lattice: bins on the lattice would halve every such wall."""
    column = np.stack([np.full(80, 7 * 0.1 + 0.05), 0.1 * np.arange(80) + 0.05], -1)
    assert hough.transform(column, 180, 0.1, split).votes[0].max() == pytest.approx(80.0)


def test_every_direction_gets_every_vote() -> None:
    votes = hough.transform(np.random.default_rng(1).uniform(-5.0, 5.0, (70, 2)), 90, 0.05).votes
    np.testing.assert_allclose(votes.sum(axis=1), 70.0)


@pytest.mark.parametrize(("angle", "rho"), [(0.0, 1.5), (np.pi / 4, -2.0), (np.radians(120.0), 0.7)])
def test_a_line_is_one_point_of_the_transform(angle: float, rho: float) -> None:
    """The thesis's figure 3.1; its angle is the normal's, its ρ the distance from the frame's origin."""
    found = hough.transform(line(angle, rho), 360, 0.05)
    k, i = np.unravel_index(np.argmax(found.votes), found.votes.shape)
    assert k * np.pi / 360 == pytest.approx(angle)
    assert found.first + i * found.resolution == pytest.approx(rho, abs=0.026)


def test_a_wall_counts_the_square_of_its_length() -> None:
    points = np.concatenate([line(0.0, 1.0, 200), line(np.pi / 2, 1.0, 100)])
    spectrum = hough.spectrum(hough.transform(points, 180, 0.05))
    assert spectrum.max() == spectrum[0] == 1.0
    assert spectrum[90] == pytest.approx(0.25, abs=0.03)


def test_spectrum_turns_with_the_map() -> None:
    points = np.concatenate([line(0.3, 1.0), line(0.9, 2.0, 90)])
    before = hough.spectrum(hough.transform(points, 360))
    after = hough.spectrum(hough.transform(points @ se2.rotation(np.radians(25.0)).T, 360))
    np.testing.assert_allclose(after, np.roll(before, 50), atol=0.03)


def test_half_a_turn_leaves_the_spectrum_alone() -> None:
    """HT(θ, ρ) = HT(θ + π, −ρ): equations 3.4 and 3.5 of the thesis."""
    points = np.random.default_rng(2).uniform(-5.0, 5.0, (200, 2))
    a, b = hough.transform(points, 90, 0.1), hough.transform(-points, 90, 0.1)
    np.testing.assert_allclose(a.votes, b.votes[:, ::-1], atol=1e-9)
    np.testing.assert_allclose(hough.spectrum(a), hough.spectrum(b), atol=1e-9)


def test_honeycomb_has_peaks_60_degrees_apart() -> None:
    """The thesis's figure 3.3."""
    walls = []
    for row in range(3):
        for column in range(3):
            centre = np.array([column * np.sqrt(3.0) + (row % 2) * np.sqrt(3.0) / 2.0, row * 1.5])
            corner = centre + np.stack(
                [np.sin(np.arange(7) * np.pi / 3), np.cos(np.arange(7) * np.pi / 3)], -1
            )
            for k in range(6):
                walls.append(corner[k] + np.linspace(0.0, 1.0, 40)[:, None] * (corner[k + 1] - corner[k]))
    spectrum = hough.spectrum(hough.transform(np.concatenate(walls) @ se2.rotation(0.2).T, 360))
    found = np.sort(peaks(spectrum, 3, 20.0)) * 180.0 / 360
    np.testing.assert_allclose(np.diff(found), 60.0, atol=0.6)
    assert np.all(spectrum[peaks(spectrum, 3, 20.0)] > 0.8)


def test_contrast_tells_rooms_from_bushes(plan: dict[str, Any]) -> None:
    rng = np.random.default_rng(3)
    segments = plan["rooms"](rng)
    walls = np.concatenate([s[:2] + rng.uniform(0.0, 1.0, (40, 1)) * (s[2:] - s[:2]) for s in segments])
    bushes = rng.normal(0.0, 5.0, (2000, 2))
    of_rooms, of_bushes = (hough.spectrum(hough.transform(p)) for p in (walls, bushes))
    assert hough.has_directions(of_rooms, DirectionConfig())
    assert hough.contrast(of_rooms)[0] > 3.0
    assert not hough.has_directions(of_bushes, DirectionConfig())
    assert hough.contrast(of_bushes)[0] == pytest.approx(1.0, abs=0.2)


def test_no_points_no_directions() -> None:
    spectrum = hough.spectrum(hough.transform(np.zeros((0, 2))))
    assert not spectrum.any()
    assert not hough.has_directions(spectrum, DirectionConfig())


SEPARATION = np.radians(10.0)


def spectrum_of(points: np.ndarray) -> np.ndarray:
    return hough.spectrum(hough.transform(points, 360, 0.1))


@pytest.fixture(scope="module")
def walls(plan: dict[str, Any]) -> np.ndarray:
    """Points on the walls of one floor plan, 2 cm of noise, about its middle."""
    rng = np.random.default_rng(5)
    segments = plan["rooms"](rng)
    parts = []
    for s in segments:
        along = np.arange(0.0, np.linalg.norm(s[2:] - s[:2]), 0.1)[:, None]
        parts.append(s[:2] + along * (s[2:] - s[:2]) / np.linalg.norm(s[2:] - s[:2]))
    points = np.concatenate(parts)
    return points + rng.normal(0.0, 0.02, points.shape) - [15.0, 10.0]


def test_correlation_by_hand() -> None:
    a, b = np.array([0.0, 0.0, 1.0, 2.0]), np.array([1.0, 2.0, 0.0, 0.0])
    np.testing.assert_allclose(cross_correlation(a, b), [0.0, 2.0, 5.0, 2.0], atol=1e-12)


def test_correlation_agrees_with_the_sum() -> None:
    rng = np.random.default_rng(0)
    a, b = rng.uniform(size=(2, 37))
    slow = [sum(b[i] * a[(i + k) % 37] for i in range(37)) for k in range(37)]
    np.testing.assert_allclose(cross_correlation(a, b), slow)


def test_spectra_of_different_length_are_refused() -> None:
    with pytest.raises(ValueError, match="different length"):
        cross_correlation(np.ones(4), np.ones(5))


@settings(deadline=None, derandomize=True, max_examples=30)
@given(st.floats(-179.0, 179.0))
def test_the_true_rotation_is_among_them(walls: np.ndarray, degrees: float) -> None:
    """p_a = R p_b, so b's points are a's turned back."""
    angle = np.radians(degrees)
    found, _ = hypotheses(
        spectrum_of(walls), spectrum_of(walls @ se2.rotation(angle)), 2, SEPARATION, np.radians(1.0)
    )
    assert np.abs(se2.wrap(found - angle)).min() < np.radians(0.3)


def test_smoothing_finds_the_angle_between_the_bins(walls: np.ndarray) -> None:
    """Bins are 0.5° apart: the bin itself is off by up to 0.25°."""
    angles = np.radians(np.linspace(3.0, 40.0, 12) + 0.13)
    errors = {}
    for smoothing in (0.0, np.radians(1.0)):
        turned = [
            hypotheses(spectrum_of(walls), spectrum_of(walls @ se2.rotation(a)), 1, SEPARATION, smoothing)[0]
            for a in angles
        ]
        errors[smoothing] = np.mean(
            [np.abs(se2.wrap(t - a)).min() for t, a in zip(turned, angles, strict=True)]
        )
    assert errors[np.radians(1.0)] < np.radians(0.06)
    assert errors[np.radians(1.0)] < 0.7 * errors[0.0]


def test_the_thesis_takes_the_bin_itself(walls: np.ndarray) -> None:
    a, b = spectrum_of(walls), spectrum_of(walls @ se2.rotation(np.radians(33.2)))
    raw, _ = hypotheses(a, b, 1, SEPARATION, 0.0)
    assert raw[0] == pytest.approx(np.argmax(cross_correlation(a, b)) * np.pi / 360)


def test_hypotheses_come_in_twins_and_right_angles(walls: np.ndarray) -> None:
    """The thesis's figure 3.8: four hypotheses, 90° apart."""
    found, scores = hypotheses(
        spectrum_of(walls), spectrum_of(walls @ se2.rotation(0.4)), 2, SEPARATION, np.radians(1.0)
    )
    np.testing.assert_allclose(np.abs(se2.wrap(found[::2] - found[1::2])), np.pi)
    np.testing.assert_allclose(np.sort(se2.wrap(4.0 * (found - 0.4))), 0.0, atol=0.05)
    assert np.all(found >= -np.pi)
    assert np.all(found < np.pi)
    assert scores[0] == scores[1] >= scores[2] == scores[3]


def test_peaks_keep_their_distance() -> None:
    a = np.zeros(360)
    a[[100, 110, 200]] = [1.0, 0.9, 0.5]  # 0°, 5° and 50° from the first
    b = np.zeros(360)
    b[0] = 1.0
    found, _ = hypotheses(a, b, 2, SEPARATION, 0.0)
    np.testing.assert_allclose(found[::2], [100 * np.pi / 360, 200 * np.pi / 360])


def test_peaks_keep_their_distance_across_the_seam() -> None:
    a = np.zeros(360)
    a[[1, 355, 180]] = [1.0, 0.9, 0.5]
    b = np.zeros(360)
    b[0] = 1.0
    found, _ = hypotheses(a, b, 2, SEPARATION, 0.0)
    np.testing.assert_allclose(found[::2], [1 * np.pi / 360, 180 * np.pi / 360])
