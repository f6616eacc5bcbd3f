"""The score between the cells is the score of the search, and its top has a width."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from slam import se2
from slam.mapping.occupancy import Grid, dilated
from stitch.alignment.config import AlignConfig, ClimbConfig, CovarianceConfig, SearchConfig
from stitch.alignment.raster import Raster, Walls
from stitch.alignment.refinement import (
    Layer,
    QuadraticPrior,
    ScoreField,
    about,
    climb_to_top,
    covariance,
    hill_climb,
    mean_of_known,
    score_field,
    sum_along,
)
from stitch.alignment.result import Prior
from stitch.alignment.translation import LINE, correlate, padded_shape, spectra

CONFIG = AlignConfig(
    resolution=0.5, climb=ClimbConfig(halvings=3), search=SearchConfig(free_penalty=5.0, lenient_penalty=5.0)
)
PENALTY = 5.0
STEP = (0.1, np.radians(1.0))


def random_raster(seed: int, shape: tuple[int, int], first: tuple[int, int]) -> Raster:
    rng = np.random.default_rng(seed)
    occupied = rng.uniform(size=shape) < 0.1
    free = (rng.uniform(size=shape) < 0.7) & ~dilated(occupied)
    facing = np.stack([occupied, 0 * occupied]).astype(np.float32)
    return Raster(occupied, free, np.array(first, dtype=float), 0.5, facing=facing)


def points_of(raster: Raster) -> np.ndarray:
    rows, columns = np.nonzero(raster.occupied)
    return (raster.first + np.stack([columns, rows], -1) + 0.5) * raster.resolution


def walls(raster: Raster) -> Walls:
    """The raster as a map of its own, every cell a point."""
    points = points_of(raster)
    grid = Grid(raster.occupied, raster.free, raster.first * raster.resolution, raster.resolution)
    return Walls(points, np.ones(len(points)), np.tile([1.0, 0.0], (len(points), 1)), grid)


def field_of(a: Raster, b: Raster, config: AlignConfig = CONFIG, prior: Prior | None = None) -> ScoreField:
    return score_field(walls(a), walls(b), prior, config)


def test_agrees_with_the_search_at_whole_cells() -> None:
    a, b = random_raster(0, (30, 24), (-4, 7)), random_raster(1, (18, 20), (2, -5))
    shape = padded_shape(a, [b])
    found = correlate(spectra(a, shape), spectra(b, shape))
    # shifts at which b lies well inside a, and one where it hangs over the border
    for row, column in [(20, 22), (25, 20), (30, 30), (40, 38)]:
        t = found.translations()[row, column]
        score = field_of(a, b).scores(np.array([[*t, 0.0]]))[0]
        expected = float(found.score(PENALTY)[row, column])
        assert score == pytest.approx(expected, rel=0.02, abs=0.5)


def test_the_outermost_wall_counts() -> None:
    """A wall in the last row of a grid is still a wall, also half a cell beyond its centre."""
    cells = np.zeros((5, 9), dtype=bool)
    cells[4] = True
    a = Raster(cells, np.zeros_like(cells), np.zeros(2), 0.5)
    scores = field_of(a, a).scores(np.array([[0.0, 0.0, 0.0], [0.0, 0.2, 0.0], [0.0, -0.2, 0.0]]))
    assert scores[0] > 9.0
    assert scores[1] == pytest.approx(scores[2])
    assert scores[1] > 0.8 * scores[0]


def test_climbing_reaches_the_top() -> None:
    a = random_raster(2, (40, 40), (-20, -20))
    field = field_of(a, a)
    T, score = hill_climb(field, np.array([0.22, -0.17, 0.03]), np.zeros(2), STEP)
    np.testing.assert_allclose(T, 0.0, atol=0.03)
    assert score > field.scores(np.array([[0.22, -0.17, 0.03]]))[0]


def test_the_kernel_climbs_the_score_it_reports() -> None:
    """With a prior and a pivot away from the origin: the slow score at the top is the kernel's."""
    a, b = random_raster(6, (40, 40), (-20, -20)), random_raster(7, (30, 36), (-9, -14))
    prior = Prior(np.array([0.3, 0.2, 0.1]), np.diag([0.5, 0.2, 0.1]) ** 2)
    field = field_of(a, b, prior=prior)
    T, score = hill_climb(field, np.array([0.1, 0.4, 0.05]), np.array([3.0, -2.0]), STEP)
    assert score == pytest.approx(float(field.scores(T[None])[0]), rel=1e-6)
    for step in np.concatenate([np.eye(3), -np.eye(3)]) * [0.0125, 0.0125, np.radians(0.125)]:
        assert field.scores(about(T, np.array([3.0, -2.0]), step[None]))[0] <= score + 1e-6


def test_agreement_and_conflict_make_the_score() -> None:
    a, b = random_raster(8, (40, 40), (-20, -20)), random_raster(9, (30, 36), (-9, -14))
    field, T = field_of(a, b), np.array([[0.3, -0.4, 0.2], [1.0, 0.0, 0.0]])
    np.testing.assert_allclose(
        field.scores(T), LINE * field.agreement(T) - PENALTY * field.conflict(T), rtol=1e-5
    )
    assert np.all(field.conflict(T) > 0.0)


def test_poses_surely_worse_than_enough_are_not_scored() -> None:
    """Those that are have the same scores."""
    field = field_of(random_raster(8, (40, 40), (-20, -20)), random_raster(9, (30, 36), (-9, -14)))
    poses = np.random.default_rng(0).normal(size=(60, 3)) * [5.0, 5.0, 1.0]
    whole = field.scores(poses)
    part = field.scores(poses, float(whole.max()))
    known = np.isfinite(part)
    np.testing.assert_array_equal(part[known], whole[known])
    assert np.all(whole[~known] < whole.max())
    assert 0 < known.sum() < len(poses)


def test_warp_widens_the_covariance_about_the_pivot() -> None:
    a, pivot = random_raster(3, (40, 40), (-20, -20)), np.array([6.0, -2.0])
    none, warped = (
        covariance(
            field_of(a, a, replace(CONFIG, covariance=CovarianceConfig(warp=warp))), np.zeros(3), pivot
        )
        for warp in ((0.0, 0.0), (0.02, 0.005))
    )
    expected = se2.transport(np.diag([0.02, 0.02, 0.005]) ** 2, np.array([*pivot, 0.0]))
    np.testing.assert_allclose(warped - none, expected, atol=1e-12)


def test_a_hotter_score_is_a_wider_one() -> None:
    a = random_raster(4, (40, 40), (-20, -20))
    cold, hot = (
        covariance(
            field_of(a, a, replace(CONFIG, covariance=CovarianceConfig(temperature=t))),
            np.zeros(3),
            np.zeros(2),
        )
        for t in (1.0, 500.0)
    )
    assert np.all(np.diag(hot) > np.diag(cold))


def test_the_prior_counts_in_the_axes_of_b() -> None:
    """b is turned a quarter: a metre along a's x is a metre along b's −y, where the prior is sure."""
    prior = Prior(np.array([1.0, 2.0, np.pi / 2]), np.diag([4.0, 0.25, 0.01]))
    T = np.array([[2.0, 2.0, np.pi / 2], [1.0, 3.0, np.pi / 2], [1.0, 2.0, np.pi / 2 + 0.2 - 2.0 * np.pi]])
    np.testing.assert_allclose(prior.distance(T), [4.0, 0.25, 4.0])
    a = random_raster(5, (20, 20), (0, 0))
    lost = field_of(a, a).scores(T) - field_of(a, a, prior=prior).scores(T)
    np.testing.assert_allclose(lost, 0.5 * CONFIG.prior.weight * prior.distance(T), atol=1e-9)


def test_the_covariance_of_the_pose_adds_to_that_of_the_prior() -> None:
    prior = Prior(np.zeros(3), np.diag([1.0, 4.0, 0.01]))
    T, sigma = np.array([2.0, 2.0, 0.1]), np.diag([3.0, 4.0, 0.03])
    assert prior.distance(T, sigma) == pytest.approx(4.0 / 4.0 + 4.0 / 8.0 + 0.01 / 0.04)
    assert se2.max_distance(0.999) == pytest.approx(16.266, abs=1e-3)  # the χ² table's, 3 degrees of freedom
    assert se2.max_distance(1.0) == np.inf


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_middle_of_what_is_known(sign: float) -> None:
    """Of four points, moved by a quarter turn, two fall on cells that say something, good or bad."""
    known = np.zeros((4, 5), dtype=np.float32)
    known[1, 2] = known[3, 4] = sign
    first, pose = np.array([-2.0, 3.0]), np.array([1.0, -2.0, np.pi / 2.0])
    # cells start at (-2, 3) of 0.5 m: (1, 2) has its middle at (0.25, 2.25), (3, 4) at (1.25, 3.25)
    there = np.array([[0.25, 2.25], [1.25, 3.25], [-0.75, 1.75], [40.0, 0.0]])
    points = se2.transform(se2.inverse(pose), there)
    found = mean_of_known(Layer(known, first, 0.5, points, np.ones(4)), pose)
    np.testing.assert_allclose(found, points[:2].mean(axis=0))
    assert not np.allclose(found, points.mean(axis=0))


def test_where_nothing_is_known_the_middle_is_that_of_all() -> None:
    points, nothing = np.array([[0.1, 0.2], [3.0, 4.0]]), np.zeros((10, 10), dtype=np.float32)
    found = mean_of_known(Layer(nothing, np.zeros(2), 0.5, points, np.ones(2)), np.zeros(3))
    np.testing.assert_allclose(found, [1.55, 2.1])


def slow_sum(
    field: np.ndarray, first: np.ndarray, points: np.ndarray, weights: np.ndarray, T: np.ndarray
) -> float:
    """Bilinear, cells of 0.5 m, nothing beyond the centres of the outermost."""
    total = 0.0
    for (x, y), weight in zip(se2.transform(T, points) / 0.5 - first - 0.5, weights, strict=True):
        if 0.0 <= x < field.shape[1] - 1 and 0.0 <= y < field.shape[0] - 1:
            i, j = int(y), int(x)
            v, u = y - i, x - j
            total += weight * np.array([1.0 - v, v]) @ field[i : i + 2, j : j + 2] @ np.array([1.0 - u, u])
    return total


def test_sums_are_those_of_the_slow_twin() -> None:
    rng = np.random.default_rng(4)
    field, first = rng.normal(size=(9, 11)).astype(np.float32), np.array([-4.0, -6.0])
    points, weights, poses = rng.uniform(-3, 3, (60, 2)), rng.uniform(size=60), rng.normal(size=(5, 3))
    expected = [slow_sum(field, first, points, weights, T) for T in poses]
    layer = Layer(field, first, 0.5, points, weights)
    np.testing.assert_allclose(sum_along(layer, poses), expected, rtol=1e-12)
    assert sum_along(layer._replace(field=field[:1]), poses).tolist() == [0.0] * 5


def test_a_climb_takes_the_steps_of_the_slow_twin() -> None:
    """The best neighbour as long as it is better, the first one in any case; the twin skips nothing."""
    rng = np.random.default_rng(5)
    field_a, field_b = (
        rng.normal(size=(30, 30)).astype(np.float32),
        -rng.uniform(size=(30, 30)).astype(np.float32),
    )
    a, b = (rng.uniform(-6.0, 6.0, (40, 2)) for _ in range(2))
    weights, first, information = rng.uniform(size=40), np.array([-15.0, -15.0]), np.diag([3.0, 1.0, 20.0])
    expected = np.array([0.2, 0.1, 0.3])

    def score(T: np.ndarray) -> float:
        error = se2.between(expected, T)
        seen = slow_sum(field_a, first, b, weights, T) + slow_sum(field_b, first, a, weights, se2.inverse(T))
        return seen - 0.5 * error @ information @ error

    for seed in range(6):
        start, step = np.random.default_rng(seed).uniform(-1.0, 1.0, 3), np.array([0.3, 0.3, 0.1])
        at, best = start, -np.inf
        for halving in range(2):
            for _ in range(5):
                steps = np.concatenate([np.eye(3), -np.eye(3)]) * step / 2**halving
                scores = [score(at + one) for one in steps]
                if max(scores) <= best:
                    break
                at, best = at + steps[int(np.argmax(scores))], max(scores)
        over_a, over_b = Layer(field_a, first, 0.5, b, weights), Layer(field_b, first, 0.5, a, weights)
        prior = QuadraticPrior(expected, information)
        found, top = climb_to_top(over_a, over_b, prior, start, np.zeros(2), step, 1, 4)
        np.testing.assert_allclose(found, at, atol=1e-9)
        assert top == pytest.approx(best)
