"""What the wall points of one map meet in another, and the likelihood of that."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from slam import se2
from slam.mapping.occupancy import Grid
from slam.se2 import Array
from stitch.alignment.config import AlignConfig
from stitch.alignment.joint import AlignmentProblem
from stitch.alignment.likelihood import (
    BIAS,
    DISTANCES,
    FACING,
    GAP_CLEARANCE,
    GAP_COSINE,
    GAP_OFFSET,
    GAPS,
    MAX_GAP,
    MIN_NORMAL,
    MISSED,
    PRIOR_BONUS,
    WEIGHTS,
    FreeSpaceMap,
    OverlapCounts,
    WallLookup,
    classify_points,
    count_gap_points,
    count_overlap,
    nearest_points,
    overlap_log_odds,
)
from stitch.alignment.raster import Walls, walls_of
from stitch.alignment.result import Prior

SIDE = 0.1
T = np.array([1.0, 2.0, np.pi / 2.0])
"""Of b in a, wherever a case is counted by hand."""
STRAIGHT, FURNITURE = 0, 1
SAME, OPPOSITE, UNKNOWN = 0, 1, 2
BESIDE_A_WALL, IN_THE_OPEN, UNSEEN = 0, 1, 2
"""Rows of the last column of counts."""


def slow_nearest(points: Array, origin: Array, shape: tuple[int, int], side: float, reach: float) -> Array:
    """Row of the nearest point for every cell, over all points."""
    rows = np.full(shape, -1)
    for i, j in np.ndindex(shape):
        distance = np.linalg.norm(points - (origin + side * (np.array([j, i]) + 0.5)), axis=1)
        if distance.min() < reach:
            rows[i, j] = np.argmin(distance)
    return rows


def test_the_nearest_point_is_that_of_the_slow_twin() -> None:
    """Also of points that lie outside of the grid, and beyond the reach."""
    rng = np.random.default_rng(0)
    origin, shape = np.array([-1.3, 0.7]), (17, 23)
    points = rng.uniform(origin - 0.5, origin + 0.13 * np.array(shape[::-1]) + 0.5, (25, 2))
    for reach in (0.35, 0.05):
        found = nearest_points(points, origin, shape, 0.13, reach)
        expected = slow_nearest(points, origin, shape, 0.13, reach)
        np.testing.assert_array_equal(found, expected)
        assert -1 in found
        assert len(np.unique(found)) > 5


def random_walls(rng: np.random.Generator, count: int, free: float) -> tuple[Array, Array, Array, Array]:
    """Points, normals (mean ones: also short ones and none), kinds, and free cells."""
    facing = se2.rotation(1.0) @ rng.normal(size=(2, count))
    facing *= rng.choice([0.0, 0.6 * MIN_NORMAL, 0.8, 1.0], count) / np.linalg.norm(facing, axis=0)
    points, kinds = rng.uniform(-0.3, 2.3, (count, 2)), rng.integers(0, 2, count)
    return points, np.ascontiguousarray(facing.T), kinds, rng.uniform(size=(20, 20)) < free


def slow_classify(
    moving: tuple[Array, Array, Array, Array],
    still: tuple[Array, Array, Array, Array],
    at: Array,
    reach: float,
) -> tuple[Array, Array]:
    """Counts by kind, facing and distance, and of what was missed, point by point."""
    met, missed = np.zeros((2, 3, len(DISTANCES))), np.zeros((2, 3))
    nearest = slow_nearest(still[0], np.zeros(2), (20, 20), SIDE, reach)
    for place, own, kind in zip(
        se2.transform(at, moving[0]), moving[1] @ se2.rotation(at[2]).T, moving[2], strict=True
    ):
        column, row = np.floor(place / SIDE).astype(int)
        if not (0 <= row < 20 and 0 <= column < 20):
            missed[kind, UNSEEN] += 1
            continue
        free = still[3][row, column]
        if nearest[row, column] < 0:
            missed[kind, IN_THE_OPEN if free else UNSEEN] += 1
            continue
        off, normal = place - still[0][nearest[row, column]], still[1][nearest[row, column]]
        known = np.linalg.norm(normal) > MIN_NORMAL
        distance = abs(off @ normal) / np.linalg.norm(normal) if known else np.linalg.norm(off)
        if free and distance > MISSED:
            missed[kind, BESIDE_A_WALL] += 1
        if distance <= DISTANCES[-1]:
            cosine = own @ normal
            way = SAME if cosine > FACING else OPPOSITE if cosine < -FACING else UNKNOWN
            met[kind, way, np.searchsorted(DISTANCES, distance)] += 1
    return met, missed


@pytest.mark.parametrize("seed", range(3))
def test_points_are_classified_as_by_the_slow_twin(seed: int) -> None:
    rng = np.random.default_rng(seed)
    moving, still = random_walls(rng, 400, 0.0), random_walls(rng, 30, 0.5)
    at, reach = np.array([0.9, 0.2, rng.uniform(0.0, 0.5)]), float(DISTANCES[-1])
    met, missed = np.zeros((2, 3, len(DISTANCES)), dtype=np.int64), np.zeros((2, 3), dtype=np.int64)
    nearest = nearest_points(still[0], np.zeros(2), (20, 20), SIDE, reach)
    onto = WallLookup(nearest, still[3], np.zeros(2), SIDE, *still[:2])
    classify_points(*moving[:3], at, onto, DISTANCES, met, missed)
    expected = slow_classify(moving, still, at, reach)
    np.testing.assert_array_equal(met, expected[0])
    np.testing.assert_array_equal(missed, expected[1])
    assert (met.sum(axis=2) > 0).all()
    assert (missed.sum(axis=0) > 0).all()


def slow_next_wall(
    place: Array, normal: Array, way: int, nearest: Array, others: tuple[Array, Array]
) -> float:
    """How far along the line the next wall in line with it is, step by step."""
    along = way * np.array([-normal[1], normal[0]])
    for far in np.arange(0.5 * SIDE, MAX_GAP + 1e-9, 0.5 * SIDE):
        column, row = np.floor((place + far * along) / SIDE).astype(int)
        if not (0 <= row < 20 and 0 <= column < 20):
            return np.inf
        if nearest[row, column] < 0:
            continue
        off, facing = others[0][nearest[row, column]] - place - far * along, others[1][nearest[row, column]]
        in_line = abs(off @ normal) <= GAP_OFFSET and abs(off @ along) <= SIDE
        if in_line and abs(facing @ normal) >= GAP_COSINE * max(np.linalg.norm(facing), MIN_NORMAL):
            return float(far)
    return np.inf


@pytest.mark.parametrize("seed", range(3))
def test_gap_points_are_those_of_the_slow_twin(seed: int) -> None:
    rng = np.random.default_rng(seed)
    moving, still = random_walls(rng, 600, 0.0), random_walls(rng, 60, 0.7)
    across = rng.choice([0.0, 0.5 * np.pi], 60)
    still[1][:] = 0.9 * np.column_stack([np.cos(across), np.sin(across)])
    moving[1][::2] = [1.0, 0.0]
    at, reach = np.array([0.1, 0.2, 0.05]), float(DISTANCES[-1])
    nearest = nearest_points(still[0], np.zeros(2), (20, 20), SIDE, reach)
    counts, expected = np.zeros(3, dtype=np.int64), np.zeros(3)
    count_gap_points(*moving[:2], at, WallLookup(nearest, still[3], np.zeros(2), SIDE, *still[:2]), counts)
    for place, own in zip(se2.transform(at, moving[0]), moving[1] @ se2.rotation(at[2]).T, strict=True):
        column, row = np.floor(place / SIDE).astype(int)
        if not (0 <= row < 20 and 0 <= column < 20) or not still[3][row, column]:
            continue
        k, size = nearest[row, column], float(np.linalg.norm(own))
        if k >= 0 and np.linalg.norm(still[0][k] - place) < GAP_CLEARANCE:
            continue
        if size <= MIN_NORMAL:
            expected[0] += 1
            continue
        sides = [slow_next_wall(place, own / size, way, nearest, still[:2]) for way in (1, -1)]
        expected[2 if sum(sides) <= MAX_GAP else min(np.isfinite(sides).sum(), 1)] += 1
    np.testing.assert_array_equal(counts, expected)
    assert counts.min() > 0


def free_space_map(
    points: Any, facing: Any, free: np.ndarray | None = None, weights: Any = 1.0
) -> FreeSpaceMap:
    """Walls on a grid of 4 m by 4 m about the origin, of which nothing is free unless told."""
    points, nothing = np.array(points, dtype=float), np.zeros((40, 40), dtype=bool)
    grid = Grid(nothing, nothing if free is None else free, np.array([-2.0, -2.0]), SIDE)
    weights = np.broadcast_to(np.array(weights, dtype=float), len(points))
    return FreeSpaceMap.of(Walls(points, weights, np.array(facing, dtype=float), grid))


ABOVE = np.zeros((40, 40), dtype=bool)
ABOVE[21:] = True
"""Free: everything above y = 0.1 m."""
NORTH, SOUTH, NOWHERE = [0.0, 1.0], [0.0, -1.0], [0.0, 0.0]


@pytest.mark.parametrize(
    ("place", "facing", "expected"),
    [
        pytest.param([0.05, 0.06], NORTH, (SAME, 0), id="same way"),
        pytest.param([0.05, 0.02], SOUTH, (OPPOSITE, 1), id="opposite"),
        pytest.param([-0.15, 0.0], NOWHERE, (UNKNOWN, 2), id="own side unknown"),
        pytest.param([0.25, -0.05], [1.0, 0.0], (UNKNOWN, 3), id="across"),
        pytest.param([0.3, 0.05], NORTH, (SAME, 0), id="along the wall is no distance"),
        pytest.param([0.05, -0.25], NORTH, (SAME, 5), id="behind"),
        pytest.param([0.05, 1.05], NORTH, (IN_THE_OPEN, 6), id="in the open"),
        pytest.param([0.05, -1.05], NORTH, (UNSEEN, 6), id="where nothing is known"),
        pytest.param([3.0, 0.0], NORTH, (UNSEEN, 6), id="off the map"),
    ],
)
@pytest.mark.parametrize(("kind", "weight"), [(STRAIGHT, 1.0), (FURNITURE, 0.5)])
def test_one_point_by_hand(
    place: list[float], facing: list[float], expected: tuple[int, int], kind: int, weight: float
) -> None:
    """a is one point of a wall, at (0.05, 0.05), that faces north; b is one point, ``place`` in a."""
    a = free_space_map([[0.05, 0.05]], [NORTH], ABOVE)
    back = se2.inverse(T)
    b = free_space_map(
        se2.transform(back, np.array([place])),
        np.array([facing]) @ se2.rotation(back[2]).T,
        weights=weight,
    )
    counts = count_overlap(a, b, T).counts
    way, distance = expected
    own = np.zeros((2, 3, 7), dtype=np.int64)
    own[kind, way, distance] = 1
    others = counts - own  # what is left is what a's point met in b
    assert others.sum() == 1
    assert others.min() == 0
    assert others[STRAIGHT].sum() == 1


def test_a_point_beside_a_wall_is_both_near_it_and_in_its_free_space() -> None:
    a = free_space_map([[0.05, 0.05]], [NORTH], ABOVE)
    b = free_space_map([[0.05, 0.27], [0.05, 0.16]], [NORTH, NORTH])
    counts = count_overlap(a, b, np.zeros(3)).counts
    assert counts[STRAIGHT, BESIDE_A_WALL, 6] == 1  # 0.11 m off is still the wall
    np.testing.assert_array_equal(counts[STRAIGHT, SAME], [0, 0, 0, 2, 0, 1, 1])


def test_all_counts_by_hand() -> None:
    """Walls that coincide for two points of three, in both maps; b's third lies in a's free space."""
    a = free_space_map([[0.05, 0.05], [1.05, 0.05]], [NORTH, NOWHERE], ABOVE, [1.0, 0.1])
    points = np.array([[0.05, 0.08], [1.05, 0.06], [0.05, 1.55]])
    back = se2.inverse(T)
    b = free_space_map(se2.transform(back, points), [[1.0, 0.0]] * 3)  # north, seen from a
    expected = np.zeros((2, 3, 7), dtype=np.int64)
    expected[STRAIGHT, SAME, 1] = 2  # 0.03 m: b's first in a, a's first in b
    expected[STRAIGHT, UNKNOWN, 0] = 1  # 0.01 m: b's second
    expected[FURNITURE, UNKNOWN, 0] = 1  # a's second
    expected[STRAIGHT, IN_THE_OPEN, 6] = 1
    np.testing.assert_array_equal(count_overlap(a, b, T).counts, expected)
    np.testing.assert_array_equal(count_overlap(b, a, se2.inverse(T)).counts, expected)


WALL = np.arange(-1.75, 1.8, 0.1)
"""Along a wall, and where it is left open in a doorway of a metre."""
DOOR = np.abs(WALL) < 0.5


def wall(x: Array, y: float) -> Array:
    return np.column_stack([x, np.full(len(x), y)])


def test_a_door_that_is_closed_in_one_map_stands_in_a_gap_of_the_other() -> None:
    """All of its points but those that the jambs may account for; in both directions, and turned."""
    free = np.zeros((40, 40), dtype=bool)
    free[17:24] = True
    back = se2.inverse(T)
    opened = free_space_map(wall(WALL[~DOOR], 0.05), [NORTH] * int((~DOOR).sum()), free)
    closed = free_space_map(
        se2.transform(back, wall(WALL, 0.05)), [NORTH @ se2.rotation(back[2]).T] * len(WALL)
    )
    in_the_gap = int((np.abs(WALL) < 0.55 - GAP_CLEARANCE).sum())
    for found in (count_overlap(opened, closed, T), count_overlap(closed, opened, back)):
        np.testing.assert_array_equal(found.gaps, [0, 0, in_the_gap])


@pytest.mark.parametrize(
    ("y", "facing", "expected"),
    [
        pytest.param(0.05, NORTH, 2, id="in line"),
        pytest.param(0.05, SOUTH, 2, id="seen from the other side"),
        pytest.param(0.45, NORTH, 0, id="in front of the wall"),
        pytest.param(0.05, [1.0, 0.0], 0, id="across the doorway"),
        pytest.param(0.05, NOWHERE, 0, id="facing nowhere"),
    ],
)
def test_furniture_is_no_door(y: float, facing: list[float], expected: int) -> None:
    """A point in the middle of a doorway, or in the room before it."""
    free = np.ones((40, 40), dtype=bool)
    opened = free_space_map(wall(WALL[~DOOR], 0.05), [NORTH] * int((~DOOR).sum()), free)
    gaps = count_overlap(opened, free_space_map([[0.0, y]], [facing]), np.zeros(3)).gaps
    np.testing.assert_array_equal(gaps, np.eye(3)[expected])


def test_where_a_wall_ends_there_is_no_gap() -> None:
    """Nor where the next wall is farther than any door is wide."""
    free = np.ones((40, 40), dtype=bool)
    end, far = WALL < -0.5, np.abs(WALL) > 0.5 * MAX_GAP + 0.1
    for stands in (end, far):
        a = free_space_map(wall(WALL[stands], 0.05), [NORTH] * int(stands.sum()), free)
        gaps = count_overlap(a, free_space_map([[0.0, 0.05]], [NORTH]), np.zeros(3)).gaps
        np.testing.assert_array_equal(gaps, [0, 1, 0])


def test_overlap_log_odds_by_hand() -> None:
    """Weights times roots, and the constant."""
    counts = np.zeros((2, 3, 7), dtype=np.int64)
    assert overlap_log_odds(OverlapCounts(counts, np.zeros(3))) == BIAS
    counts[0, 0, 0], counts[1, 2, 6], counts[1, 1, 1] = 16, 9, 100
    expected = 4.0 * WEIGHTS[0, 0, 0] + 3.0 * WEIGHTS[1, 2, 6] + 10.0 * WEIGHTS[1, 1, 1]
    expected += GAPS @ [6.0, 10.0, 2.0] + BIAS
    assert overlap_log_odds(OverlapCounts(counts, np.array([36, 100, 4]))) == pytest.approx(expected)


def test_what_was_learnt_is_sane() -> None:
    """Walls that coincide speak for the same place; walls in free space speak against it, most of all where
    the other has a door; few do not suffice."""
    same, against = np.zeros((2, 3, 7), dtype=np.int64), np.zeros((2, 3, 7), dtype=np.int64)
    same[STRAIGHT, SAME, :3] = 300
    against[STRAIGHT, IN_THE_OPEN, 6] = 300
    nothing, nowhere, doors = 0 * same, np.zeros(3), np.array([0, 0, 30])
    assert overlap_log_odds(OverlapCounts(same, nowhere)) > overlap_log_odds(OverlapCounts(nothing, nowhere))
    assert overlap_log_odds(OverlapCounts(nothing, nowhere)) > overlap_log_odds(
        OverlapCounts(against, nowhere)
    )
    assert overlap_log_odds(OverlapCounts(same, nowhere)) > overlap_log_odds(
        OverlapCounts(same + against, nowhere)
    )
    assert overlap_log_odds(OverlapCounts(same, nowhere)) > overlap_log_odds(OverlapCounts(same, doors))
    assert overlap_log_odds(OverlapCounts(nothing, nowhere)) < 0.0
    assert PRIOR_BONUS > 0.0


@pytest.fixture(scope="module")
def back_to_back(plan: dict[str, Callable[..., Any]]) -> tuple[Walls, Walls, Walls]:
    """A room, the room behind its long wall, and the first once more; all in the building's frame."""
    rng = np.random.default_rng(0)
    rooms = np.array([*plan["box"](0.0, 0.0, 8.0, 3.0), *plan["box"](0.0, -3.0, 8.0, 0.0)])
    x = np.linspace(1.0, 7.0, 12)
    up, down = (np.column_stack([x, np.full(12, y), x]) for y in (1.5, -1.5))
    first, behind, again = (
        walls_of(plan["see"](rooms, poses, np.zeros(3), rng), 0.1) for poses in (up, down, up)
    )
    return first, behind, again


def test_walls_face_who_saw_them(back_to_back: tuple[Walls, Walls, Walls]) -> None:
    for walls, sign in zip(back_to_back[:2], (1.0, -1.0), strict=True):
        shared = (np.abs(walls.points[:, 1]) < 0.05) & (np.abs(walls.points[:, 0] - 4.0) < 3.0)
        assert shared.sum() > 40
        along, across = walls.facing[shared].T
        assert np.all(sign * across >= 0.0)  # a mean with points that have no normal is short
        assert np.median(sign * across) > 0.99
        assert np.abs(along).max() < 0.1


def test_walls_back_to_back_are_less_likely(back_to_back: tuple[Walls, Walls, Walls]) -> None:
    """The wall between two rooms coincides with itself to the millimetre; they are two places still."""
    first, behind, again = (FreeSpaceMap.of(walls) for walls in back_to_back)
    apart, same = (count_overlap(first, other, np.zeros(3)).counts for other in (behind, again))
    assert apart[:, OPPOSITE, :2].sum() > 120
    assert apart[:, SAME, :2].sum() < 0.1 * apart[:, OPPOSITE, :2].sum()
    assert same[:, OPPOSITE, :6].sum() < 0.05 * same[:, SAME, :6].sum()
    turned = apart.copy()
    turned[:, [SAME, OPPOSITE], :6] = apart[:, [OPPOSITE, SAME], :6]  # as if seen from the same side
    likely = [overlap_log_odds(OverlapCounts(counts, np.zeros(3))) for counts in (same, turned, apart)]
    assert likely == sorted(likely, reverse=True)


def test_a_prior_adds_a_constant_and_takes_the_distance(
    back_to_back: tuple[Walls, Walls, Walls],
) -> None:
    """2σ along b's x and 1σ in yaw are ½·(4 + 1)."""
    first, _, again = back_to_back
    at = np.array([0.2, 0.0, 0.0])
    prior = Prior(np.array([0.0, 0.0, 0.1]), np.diag([0.01, 1e4, 0.01]))
    alone, told = (
        AlignmentProblem.of(first, again, known, AlignConfig()).log_odds(at) for known in (None, prior)
    )
    distance = (0.2 * np.cos(0.1) / 0.1) ** 2 + 1.0  # in the axes of the expected b
    assert alone == overlap_log_odds(count_overlap(FreeSpaceMap.of(first), FreeSpaceMap.of(again), at))
    assert told - alone == pytest.approx(PRIOR_BONUS - 0.5 * distance, abs=1e-3)
