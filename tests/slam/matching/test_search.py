"""Looking elsewhere: bad guesses, open directions, and knowing when the answer might be another."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from slam import se2
from slam.matching import Match, MatchConfig, Reference, match
from slam.matching.search import best_apart, correlate, misfit, smear, spread_of, thin_out
from slam.scan import Scan
from slam.se2 import Array

FROM = np.array([2.0, 2.5, 0.3])
MOVED = np.array([0.15, -0.08, 0.06])
ALONE = MatchConfig(search_shift=0.0)
DEFAULT = MatchConfig()
SETTINGS = DEFAULT.kernel_settings
CELL, ANGLE, CAP = DEFAULT.search_cell, DEFAULT.search_angle, DEFAULT.misfit_cap
BADLY = np.array([-0.55, -0.55, -0.5])
"""An error of a guess that the descent alone does not recover from."""

Look = Callable[..., Scan]


def off(T: Array, answer: object) -> float:
    """Distance [m, rad] of an answer from the truth, infinite without one."""
    return (
        float(np.abs(se2.log(se2.between(answer.T_reference_scan, T))).max())
        if isinstance(answer, Match)
        else np.inf
    )


def window(shift: float, turn: float) -> Any:
    """Kernel settings with a search this wide [m, rad]."""
    return SETTINGS._replace(search_shift=shift, search_turn=turn)


def test_bad_guesses_are_found_again(room: Array, look: Look) -> None:
    rng = np.random.default_rng(0)
    reference, scan = look(room, FROM, rng), look(room, se2.compose(FROM, MOVED), rng)
    reference_, scan_ = Reference(reference), Reference(scan)
    signs = rng.choice([-1.0, 1.0], (40, 3))
    guesses = MOVED + signs * [0.55, 0.55, np.radians(29.0)] * rng.uniform(0.9, 1.0, (40, 3))
    searched = np.array([off(MOVED, match(reference_, scan_, guess)) for guess in guesses])
    alone = np.array([off(MOVED, match(reference_, scan_, guess, config=ALONE)) for guess in guesses])
    assert np.all(searched < 0.02)
    assert np.sum(alone > 0.02) >= 2  # the search is what found them


def test_the_same_scan_again_is_a_robot_at_rest(corridor: Array, look: Look) -> None:
    rng = np.random.default_rng(1)
    reference = look(corridor, np.zeros(3), rng)
    guess = np.array([0.3, 0.05, 0.1])
    # Seen again to the last digit, noise and all: no other place in the corridor explains that as well.
    again = match(reference, reference, guess)
    assert off(np.zeros(3), again) < 1e-6
    # A scan with noise of its own may be from anywhere along it, and says so.
    other = match(reference, look(corridor, np.zeros(3), rng), guess)
    assert isinstance(other, Match)
    assert np.sqrt(other.covariance[0, 0]) > 0.3


def test_answers_that_fit_as_well_widen_the_covariance() -> None:
    best = np.array([1.0, 0.0, np.pi - 0.01])
    others = np.array([[1.3, 0.0, np.pi - 0.01], [1.0, 0.0, -np.pi + 0.09], [9.0, 9.0, 0.0]])
    costs = np.array([50.0, 50.0 + 2.0 * 10.0 * np.log(2.0), 1e6])
    # Weights 1 (itself), 1, ½ and 0: 0.09 and 0.01 over 2.5.
    np.testing.assert_allclose(
        spread_of(others, costs, best, 50.0, 10.0), np.diag([0.036, 0.0, 0.002]), atol=1e-9
    )
    np.testing.assert_array_equal(
        spread_of(np.empty((0, 3)), np.empty(0), best, 50.0, 10.0), np.zeros((3, 3))
    )


def test_a_prior_outweighs_a_repeated_scan(corridor: Array, look: Look) -> None:
    reference = look(corridor, np.zeros(3), np.random.default_rng(1))
    guess = np.array([0.3, 0.0, 0.0])
    known = match(reference, reference, guess, prior_information=np.diag([1e6, 1.0, 1.0]))
    assert isinstance(known, Match)
    assert known.T_reference_scan[0] == pytest.approx(0.3, abs=0.01)


def test_far_points_do_not_make_a_huge_raster() -> None:
    far = np.array([[1.0, 0.0], [5e4, 0.0], [0.0, 2.0]])
    np.testing.assert_array_equal(thin_out(far, SETTINGS), far[[0, 2]])
    assert len(thin_out(far[1:2], SETTINGS)) == 0


def test_a_prior_narrows_the_search(room: Array, look: Look) -> None:
    rng = np.random.default_rng(3)
    reference, scan = look(room, FROM, rng), look(room, se2.compose(FROM, MOVED), rng)
    sure = np.diag([1e8, 1e8, 1e8])
    guess = MOVED + np.array([0.4, 0.3, 0.4])
    stayed = match(reference, scan, guess, prior_information=sure)
    assert not off(MOVED, stayed) < 0.1


def test_twin_of_misfit(room: Array, look: Look) -> None:
    rng = np.random.default_rng(4)
    reference, scan = look(room, FROM, rng), look(room, se2.compose(FROM, MOVED), rng)
    rows = np.arange(len(scan))
    pairs = np.where(rows % 3 == 0, -1, rows % len(reference))
    R = se2.rotation(MOVED[2])
    total = 0.0
    for i, j in enumerate(pairs):
        if j < 0:
            total += 0.5 * CAP
            continue
        e = reference.points[j] - R @ scan.points[i] - MOVED[:2]
        P = reference.covariance[j] + R @ scan.covariance[i] @ R.T
        n, m = reference.normals[j], R @ scan.normals[i]
        if np.isnan(n @ m):
            total += min(e @ np.linalg.solve(P, e), CAP)
        elif n @ m > 0.7:
            total += min((n @ e) ** 2 / (n @ P @ n), CAP)
        else:
            total += CAP
    clouds = Reference(reference).cloud, Reference(scan).cloud
    assert misfit(*clouds, pairs, MOVED, CAP, DEFAULT.same_side) == pytest.approx(total / len(scan), rel=1e-9)


def test_smear_is_the_nearest_points_bell() -> None:
    points = np.array([[0.05, 0.05], [0.35, 0.05], [np.nan, np.nan]])
    raster = smear(points, np.array([-0.5, -0.5]), np.array([1.0, 0.5]), CELL)
    assert raster.shape == (11, 16)
    assert raster[5, 5] == raster[5, 8] == 1.0
    assert raster[5, 6] == pytest.approx(np.exp(-0.5))
    assert raster[6, 6] == pytest.approx(np.exp(-1.0))
    assert raster[5, 11] == 0.0


def test_twin_of_correlate(room: Array, look: Look) -> None:
    rng = np.random.default_rng(5)
    points, scan = look(room, FROM, rng).points, thin_out(look(room, FROM, rng).points, SETTINGS)[::6]
    guess = np.array([0.21, -0.13, 0.1])
    scores = correlate(points, scan, guess, window(0.2, 2.0 * ANGLE))
    assert scores.shape == (5, 5, 5)
    reach = np.linalg.norm(scan, axis=1).max() + 0.2 + 3.0 * CELL
    raster = smear(points, guess[:2] - reach, guess[:2] + reach, CELL)
    for k, r, q in ((0, 0, 0), (2, 2, 2), (4, 1, 3), (3, 4, 0)):
        pose = guess + np.array([(q - 2) * CELL, (r - 2) * CELL, (k - 2) * ANGLE])
        cells = np.floor((se2.transform(pose, scan) - guess[:2] + reach) / CELL + 1e-9).astype(int)
        assert scores[k, r, q] == pytest.approx(np.sum(raster[cells[:, 1], cells[:, 0]]), rel=0.02)


def test_the_best_scores_are_apart() -> None:
    scores = np.zeros((9, 9, 9), np.float32)
    scores[4, 4, 4], scores[4, 4, 5], scores[4, 4, 8], scores[0, 4, 4] = 9.0, 8.0, 7.0, 6.0
    poses = best_apart(scores, np.array([1.0, 2.0, 0.5]), SETTINGS)
    np.testing.assert_allclose(
        poses, [[1.0, 2.0, 0.5], [1.0 + 4 * CELL, 2.0, 0.5], [1.0, 2.0, 0.5 - 4 * ANGLE]], atol=1e-12
    )


def test_thinned_points_keep_their_distance() -> None:
    points = np.column_stack([np.arange(0.0, 3.0, 0.01), np.zeros(300)])
    kept = thin_out(points, SETTINGS)
    assert 25 <= len(kept) <= 90
    assert np.all(np.diff(kept[:, 0]) >= 0.1 - 1e-9)


@pytest.mark.parametrize(
    "change", [{"search_shift": 0.0}, {"least_share": 0.0, "most_misfit": 1e9}, {"margin": 1e9}]
)
def test_every_setting_of_the_search_changes_something(
    room: Array, look: Look, change: dict[str, object]
) -> None:
    rng = np.random.default_rng(6)
    reference, scan = look(room, FROM, rng), look(room, se2.compose(FROM, MOVED), rng)
    guess = MOVED + BADLY
    assert off(MOVED, match(reference, scan, guess)) < 0.02
    changed = match(reference, scan, guess, config=replace(MatchConfig(), **change))  # type: ignore[arg-type]
    assert off(MOVED, changed) > 0.02


@pytest.mark.parametrize(
    ("shift", "turn", "poses"), [(0.2, 4.0, (5, 5, 5)), (0.3, 4.0, (5, 7, 7)), (0.2, 8.0, (9, 5, 5))]
)
def test_the_window_is_as_wide_as_asked(shift: float, turn: float, poses: tuple[int, int, int]) -> None:
    points = np.array([[1.0, 0.0], [0.0, 2.0]])
    assert correlate(points, points, np.zeros(3), window(shift, np.radians(turn))).shape == poses


def test_directions_that_are_known_well_enough_are_not_searched(corridor: Array, look: Look) -> None:
    rng = np.random.default_rng(7)
    reference, scan = (look(corridor, np.array([x, 0.0, 0.0]), rng) for x in (0.0, 0.1))
    tried = [
        match(reference, scan, np.zeros(3), config=MatchConfig(open_direction=least)).tried  # type: ignore[union-attr]
        for least in (10.0, -1e9)
    ]
    assert tried[0] > 1 == tried[1]
