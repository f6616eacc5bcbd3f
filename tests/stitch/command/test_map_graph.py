"""Many maps: what hangs together, what is outvoted, and what nobody can decide."""

from __future__ import annotations

import numpy as np
import pytest

from slam import se2
from stitch.alignment.result import NoStitch, Stitch
from stitch.command.map_graph import MapGraph, join

TRUTH = np.array([[0.0, 0, 0], [10, 2, 0.5], [18, -3, -1.0], [9, -12, 2.0], [30, 0, 3.0]])
SIGMA = np.diag([0.02, 0.02, 0.005]) ** 2


def graph_of(
    pairs: list[tuple[int, int]], false: tuple[tuple[int, int], ...] = (), count: int = 4
) -> MapGraph:
    """Maps joined by true stitches with a little noise, and by false ones 3 m off."""
    rng = np.random.default_rng(0)

    def stitch(a: int, b: int) -> Stitch | NoStitch:
        if (a, b) not in (*pairs, *false):
            return NoStitch("no overlap")
        T = se2.compose(se2.between(TRUTH[a], TRUTH[b]), se2.exp(rng.normal(0.0, [0.02, 0.02, 0.005])))
        return Stitch(se2.compose(T, [3.0, 0, 0]) if (a, b) in false else T, SIGMA, 100.0, 50.0, 0.9)

    return join(count, stitch)


def check_poses(found: MapGraph) -> None:
    error = se2.between(TRUTH[list(found.members)], found.poses)
    assert np.all(np.abs(error) < [0.3, 0.3, 0.03])


def test_a_chain():
    found = graph_of([(0, 1), (1, 2), (2, 3)])
    assert found.members == (0, 1, 2, 3)
    assert len(found.results) == 6
    check_poses(found)
    deviation = np.sqrt(found.covariances[:, 2, 2])
    np.testing.assert_allclose(deviation[1:], 0.005 * np.sqrt([1, 2, 3]), rtol=0.01)


def test_a_map_that_does_not_hang_together_with_the_first_is_left_out():
    found = graph_of([(0, 2), (1, 3)])
    assert found.members == (0, 2)
    assert found.trusted == {(0, 2)}
    check_poses(found)


def test_nothing_to_join():
    found = graph_of([(1, 2)])
    assert found.members == (0,)
    assert found.trusted == frozenset()


def test_a_false_stitch_is_outvoted():
    true = [(0, 1), (1, 2), (0, 3), (2, 3), (1, 3)]
    found = graph_of(true, false=((0, 2),))
    assert found.trusted == set(true)
    check_poses(found)


@pytest.mark.parametrize("false", [(0, 1), (1, 2), (0, 2)])
def test_two_against_one_in_a_ring_decides_nothing(false):
    """Whichever of the three is left out, the other two agree."""
    found = graph_of([pair for pair in [(0, 1), (1, 2), (0, 2)] if pair != false], (false,), count=3)
    assert found.members == (0,)


def test_a_ring_that_contradicts_itself_costs_only_the_maps_behind_it():
    found = graph_of([(0, 1), (1, 2), (2, 3), (3, 4)], false=((2, 4),), count=5)
    assert found.members == (0, 1, 2)
    check_poses(found)
