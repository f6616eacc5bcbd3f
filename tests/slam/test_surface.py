"""Tangents and point covariances against lines, corners and the obvious slow twins."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad

from slam import se2
from slam.recording import Laser
from slam.scan import Scan, ScanConfig
from slam.se2 import Array
from slam.surface import correspondence_variance, losses, point_covariances, tangents_of_beams

quick = settings(deadline=None, max_examples=60, derandomize=True)

SIGMA = 0.01
REACH, INCIDENCE = 12, np.pi / 8.0


def tangents(
    points: Array, spacing: float = 0.02, radius: float = 0.3, bridging: bool = False
) -> tuple[Array, Array]:
    return tangents_of_beams(points, np.full(len(points), spacing), radius, SIGMA, REACH, bridging)


def modulo_half_turn(angle: Array) -> Array:
    return 0.5 * se2.wrap(2.0 * angle)


@quick
@given(st.floats(-np.pi, np.pi), st.floats(0.3, 10.0))
def test_a_straight_wall(direction: float, distance: float) -> None:
    along = np.arange(-10, 11)[:, None] * 0.05 * [np.cos(direction), np.sin(direction)]
    found, deviation = tangents(
        along + distance * np.array([-np.sin(direction), np.cos(direction)]), radius=0.28
    )
    np.testing.assert_allclose(modulo_half_turn(found - direction), 0.0, atol=1e-6)
    # 11 points (5 on either side lie within 0.28 m), 5 cm apart: scatter 0.05² · Σ k².
    assert deviation[10] == pytest.approx(
        SIGMA / np.sqrt(0.05**2 * 2 * np.sum(np.arange(1, 6) ** 2)), rel=1e-6
    )


def test_deviation_is_that_of_noisy_walls() -> None:
    rng = np.random.default_rng(2)
    walls = np.stack([np.tile(np.arange(25) * 0.02, (2000, 1)), rng.normal(0.0, SIGMA, (2000, 25))], -1)
    results = [tangents(wall) for wall in walls]
    errors = [modulo_half_turn(found[12]) for found, _ in results]
    predicted = np.mean([deviation[12] for _, deviation in results])
    assert np.std(errors) == pytest.approx(predicted, rel=0.1)


@pytest.mark.parametrize("gap", [0.02, 0.05])
def test_a_tangent_bent_by_a_corner_is_not_claimed_with_confidence(gap: float) -> None:
    side = np.arange(gap, 1.0, gap)[:, None]
    points = np.concatenate([side[::-1] * [1.0, 0.0], [[0.0, 0.0]], side * [0.0, 1.0]])
    from_corner = np.abs(np.arange(len(points)) - len(side))
    found, deviation = tangents(points)
    off = np.abs(modulo_half_turn(found - np.where(np.arange(len(points)) < len(side), 0.0, np.pi / 2)))
    assert np.all((off < 4.5 * deviation) | np.isnan(found))
    np.testing.assert_allclose(off[from_corner > REACH], 0.0, atol=1e-6)
    assert np.all(np.isnan(found[from_corner <= 2])) == (gap == 0.02)


def test_a_step_in_depth_is_not_bridged() -> None:
    y = np.arange(0.0, 1.0, 0.05)
    points = np.stack([np.where(y < 0.48, 2.0, 3.0), y], -1)
    found, _ = tangents(points)
    np.testing.assert_allclose(np.abs(modulo_half_turn(found - np.pi / 2)), 0.0, atol=1e-6)


def test_a_wall_keeps_its_tangents_where_beams_are_lost() -> None:
    points = np.stack([np.full(40, 2.0), 0.02 * np.arange(40)], -1)
    points[1::2] = np.nan
    assert np.all(np.isnan(tangents(points)[0]))
    found, _ = tangents(points, bridging=True)
    np.testing.assert_allclose(np.abs(modulo_half_turn(found[::2] - np.pi / 2)), 0.0, atol=1e-6)


def test_beams_lost_by_chance_are_told_from_those_that_see_nothing_together() -> None:
    rng = np.random.default_rng(4)
    by_chance, together = np.ones(2000), np.ones(2000)
    by_chance[rng.random(2000) < 0.4] = np.nan
    together[300:1100] = np.nan
    assert losses(by_chance) == pytest.approx((0.4, 1.0), abs=0.1)
    assert losses(together)[0] == 0.4
    assert losses(together)[1] < 0.01
    assert losses(np.ones(9)) == (0.0, 0.0)
    assert losses(np.full(9, np.nan)) == (1.0, 0.0)


def test_a_scan_bridges_what_was_lost_by_chance_and_nothing_else() -> None:
    angles = np.radians(np.arange(-60.0, 61.0))
    by_chance, together = 2.0 / np.cos(angles), 2.0 / np.cos(angles)
    by_chance[1::2] = np.nan
    together[50:70], together[72:100] = np.nan, np.nan
    never = ScanConfig(least_independence=np.inf)
    seen, unbridged = (
        [
            np.isfinite(Scan.from_ranges(ranges, angles, Laser(), config).normals[:, 0])
            for ranges in (by_chance, together)
        ]
        for config in (ScanConfig(), never)
    )
    assert seen[0].mean() > 0.95
    assert not unbridged[0].any()
    np.testing.assert_array_equal(seen[1], unbridged[1])


def test_lonely_points_have_no_tangent() -> None:
    points = np.array([[1.0, 0.0], [1.0, 0.02], [np.nan, np.nan], [3.0, 0.0], [np.nan, np.nan], [1.0, 0.1]])
    found, deviation = tangents(points)
    assert np.all(np.isnan(found))
    assert np.all(np.isnan(deviation))


def test_far_walls_are_read_over_a_longer_stretch() -> None:
    points = np.stack([np.full(15, 9.0), 0.4 * np.arange(15)], -1)
    assert np.all(np.isnan(tangents(points, spacing=0.02)[0]))
    assert np.all(np.isfinite(tangents(points, spacing=0.4)[0]))


def slow_tangent(points: Array, i: int, reach: float, bridging: bool) -> tuple[float, float]:
    """The principal axis of the run about i over the beams that returned, at the reach or half of it; an
    unbroken run unless ``bridging``."""
    there = np.flatnonzero(np.isfinite(points[:, 0]))
    for radius in (reach, reach / 2):
        run = [i]
        for others in (there[there > i], there[there < i][::-1]):
            last = i
            for k in others[np.abs(others - i) <= REACH]:
                apart = [np.linalg.norm(points[k] - points[j]) for j in (last, i)]
                if max(apart) > radius or (abs(k - last) > 1 and not bridging):
                    break
                last = k
                run.append(k)
        if len(run) < 3:
            break
        scatter = np.cov(points[run].T, bias=True) * len(run)
        values, vectors = np.linalg.eigh(scatter)
        rms = np.sqrt(max(values[0], 0.0) / len(run))
        if rms <= 3.0 * SIGMA:
            return float(np.arctan2(*vectors[::-1, 1])), max(SIGMA, rms) / np.sqrt(values[1])
    return np.nan, np.nan


@pytest.mark.parametrize("bridging", [False, True])
def test_twin_of_tangents(bridging: bool) -> None:
    rng = np.random.default_rng(3)
    for _ in range(10):
        points = np.cumsum(rng.normal([0.04, 0.0], [0.02, 0.015], (60, 2)), axis=0)
        points[rng.random(60) < 0.08] = np.nan
        points[30:] += rng.choice([0.0, 1.0])
        found, deviation = tangents(points, bridging=bridging)
        for i in np.flatnonzero(np.isfinite(points[:, 0])):
            angle, sigma = slow_tangent(points, int(i), 0.3, bridging)
            np.testing.assert_allclose(np.exp(2j * found[i]), np.exp(2j * angle), atol=1e-7)
            np.testing.assert_allclose(deviation[i], sigma, rtol=1e-7)


def hit(distance: float, incidence: float, beam: float) -> float:
    """Where along a surface a beam turned by ``beam`` meets it, from where the beam at zero does."""
    ray = np.array([np.cos(beam), np.sin(beam)])
    surface = np.array([np.cos(incidence), np.sin(incidence)])
    return float(np.linalg.solve(np.stack([ray, -surface], -1), [distance, 0.0])[1])


@quick
@given(st.floats(0.1, 20.0), st.floats(0.1, np.pi / 2), st.sampled_from([0.25, 0.5, 1.0, 2.0]))
def test_correspondence_variance_is_the_integral_over_the_gaps(
    distance: float, incidence: float, degrees: float
) -> None:
    spacing = float(np.radians(degrees))
    ends = sorted([hit(distance, incidence, spacing), hit(distance, incidence, -spacing)])
    second_moment = quad(lambda s: s * s, *ends)[0] / (ends[1] - ends[0])
    assert correspondence_variance(distance, incidence, spacing) == pytest.approx(second_moment, rel=1e-6)


def test_grazing_beams_stay_finite() -> None:
    spacing = np.radians(1.0)
    clamped = correspondence_variance(3.0, 2.0 * spacing, spacing)
    assert np.isfinite(clamped)
    for incidence in (0.0, 0.5 * spacing, spacing, 1.5 * spacing):
        assert correspondence_variance(3.0, incidence, spacing) == clamped
    assert correspondence_variance(3.0, np.pi / 4, spacing) < clamped


def test_twin_of_point_covariances() -> None:
    rng = np.random.default_rng(4)
    ranges, angles = rng.uniform(0.5, 8.0, 30), np.linspace(-2.0, 2.0, 30)
    direction = rng.uniform(-np.pi, np.pi, 30)
    direction[::5], ranges[3] = np.nan, np.nan
    spacing, sigma_range, sigma_angle = 0.02, 0.015, 2e-3
    found = point_covariances(ranges, angles, direction, spacing, sigma_range, sigma_angle, INCIDENCE)
    for i in range(30):
        if np.isnan(ranges[i]):
            assert np.all(np.isnan(found[i]))
            continue
        R = se2.rotation(angles[i])
        P = R @ np.diag([sigma_range**2, (ranges[i] * sigma_angle) ** 2]) @ R.T
        if np.isnan(direction[i]):
            P = P + correspondence_variance(ranges[i], INCIDENCE, spacing) * np.eye(2)
        else:
            e = np.array([np.cos(direction[i]), np.sin(direction[i])])
            incidence = np.abs(modulo_half_turn(angles[i] - direction[i]))
            P = P + correspondence_variance(ranges[i], incidence, spacing) * np.outer(e, e)
        np.testing.assert_allclose(found[i], P, rtol=1e-9, atol=1e-15)
