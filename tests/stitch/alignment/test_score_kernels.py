"""The score's kernels against answers by hand and slow twins."""

from __future__ import annotations

import numpy as np
import pytest

from slam import se2
from stitch.alignment.score_kernels import Layer, QuadraticPrior, hill_climb, mean_of_known, sum_along


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
        found, top = hill_climb(over_a, over_b, prior, start, np.zeros(2), step, 1, 4)
        np.testing.assert_allclose(found, at, atol=1e-9)
        assert top == pytest.approx(best)
