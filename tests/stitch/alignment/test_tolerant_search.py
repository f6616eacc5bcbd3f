"""The search of bent maps finds where they lie, and its sums are those of a loop over the walls."""

from __future__ import annotations

import numpy as np

from slam import se2
from stitch.alignment.candidates import distinct
from stitch.alignment.config import TolerantConfig
from stitch.alignment.facing import facing_walls
from stitch.alignment.tolerant_search import STEP, agreement_field, search
from tests.stitch.alignment import bent_rooms

CONFIG = TolerantConfig()


def test_the_true_place_comes_first_though_the_map_is_bent() -> None:
    a, b = (facing_walls(submap, CONFIG.unknown_weight) for submap in bent_rooms.pair())
    best, *others = search(a, b, CONFIG)
    shared = b.points[bent_rooms.true_places(b.points)[:, 0] < 20.0]
    off = se2.transform(best.T_a_b, shared) - bent_rooms.true_places(shared)
    assert np.mean(np.linalg.norm(off, axis=1)) < 1.0
    assert len(others) == CONFIG.candidates - 1
    assert best.score > others[0].score


def test_the_score_is_the_sum_over_the_walls_of_both() -> None:
    a, b = (facing_walls(submap, CONFIG.unknown_weight) for submap in bent_rooms.pair())
    best = search(a, b, CONFIG)[0]
    slow = _met(b, a, best.T_a_b) + _met(a, b, se2.inverse(best.T_a_b))
    assert abs(slow - best.score) < 0.06 * abs(slow)


def _met(walls, of, T) -> float:  # type: ignore[no-untyped-def]
    """What the walls of one map meet in the field of another, between its cells."""
    from scipy.ndimage import map_coordinates

    field, first = agreement_field(of, CONFIG)
    cells = ((se2.transform(T, walls.points) - first) / STEP).T[::-1]
    one, c1, s1, c2, s2 = (map_coordinates(layer, cells, order=1) for layer in field)
    phi = walls.angles + T[2]
    facing = c1 * np.cos(phi) + s1 * np.sin(phi) + c2 * np.cos(2 * phi) + s2 * np.sin(2 * phi)
    return float(np.sum(walls.weights * (one + np.where(walls.known, facing, 0.0))))


def test_candidates_near_a_better_one_are_left_out() -> None:
    poses = np.array([(0.0, 0.0, 0.0), (0.5, 0.0, 0.0), (0.5, 0.0, 1.0), (3.0, 0.0, 0.0)])
    assert distinct(poses, np.zeros(2), (1.0, 0.2)) == [0, 2, 3]
    assert distinct(poses, np.zeros(2), (1.0, 0.2), 2) == [0, 2]
    turned_about_another_place = distinct(poses, np.array([0.0, 9.0]), (1.0, 2.0))
    assert turned_about_another_place == [0, 2, 3]
