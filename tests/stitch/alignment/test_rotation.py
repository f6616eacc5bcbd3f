"""Rotations come from the spectra, in pairs."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from slam import se2
from stitch.alignment import hough
from stitch.alignment.rotation import cross_correlation, hypotheses

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
