"""Routes through drawn maps: they keep clear, go far, come back, and say why where nobody can drive."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sim.route import LONGEST, NoRouteError, clearance, plan
from slam.mapping.occupancy import Grid
from slam.se2 import Array

RADIUS = 0.23
ORIGIN = np.array([-3.0, 2.0])


def grid(occupied: np.ndarray, resolution: float = 0.05, unknown: np.ndarray | None = None) -> Grid:
    free = ~occupied if unknown is None else ~occupied & ~unknown
    return Grid(occupied, free, ORIGIN, resolution)


def rooms(columns: int = 3, rows: int = 2, side: int = 80, door: int = 20) -> np.ndarray:
    """Square rooms with a door in every wall between two of them."""
    occupied = np.zeros((rows * side + 1, columns * side + 1), dtype=bool)
    occupied[::side], occupied[:, ::side] = True, True
    middle = np.arange(-door // 2, door // 2) + side // 2
    for row in range(1, rows):
        for column in range(columns):
            occupied[row * side, column * side + middle] = False
    for column in range(1, columns):
        for row in range(rows):
            occupied[row * side + middle, column * side] = False
    return occupied


def driven(route: Array, spacing: float = 0.01) -> Array:
    """Points along the route."""
    length = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(route, axis=0).T))])
    at = np.arange(0.0, length[-1], spacing)
    return np.stack([np.interp(at, length, route[:, k]) for k in (0, 1)], -1)


def room_along(drawn: Grid, points: Array) -> Array:
    """Distance of points (n, 2) from the nearest cell that is not free."""
    rows, columns = np.nonzero(~drawn.free)
    lower = drawn.origin + np.stack([columns, rows], -1) * drawn.resolution
    nearest = np.clip(points[:, None], lower, lower + drawn.resolution)
    return np.hypot(*np.moveaxis(nearest - points[:, None], -1, 0)).min(axis=1)


@settings(max_examples=10, deadline=None)
@given(st.integers(0, 10_000), st.sampled_from([0.03, 0.05, 0.1]))
def test_the_robot_fits_everywhere_on_its_route(seed: int, resolution: float) -> None:
    side = round(4.0 / resolution)
    drawn = grid(rooms(2, 2, side, round(1.0 / resolution)), resolution)
    route = plan(drawn, RADIUS, np.random.default_rng(seed))
    assert room_along(drawn, driven(route)[::17]).min() >= RADIUS


@pytest.mark.parametrize("seed", range(4))
def test_a_route_visits_far_rooms_comes_home_and_goes_round_again(seed: int) -> None:
    route = plan(grid(rooms()), RADIUS, np.random.default_rng(seed))
    room = np.unique(np.floor((route - ORIGIN) / 4.0).astype(int), axis=0)
    assert len(room) >= 5  # of six
    home = np.hypot(*(route - route[0]).T) < 0.3
    visits = np.count_nonzero(np.diff(home.astype(int)) == 1)
    assert home[-1]
    assert visits >= 2
    assert np.hypot(*np.diff(route, axis=0).T).sum() < 1.1 * LONGEST


def test_seeds_vary_the_route_and_one_seed_does_not() -> None:
    drawn = grid(rooms())
    one, same, other = (plan(drawn, RADIUS, np.random.default_rng(seed)) for seed in (1, 1, 2))
    np.testing.assert_array_equal(one, same)
    assert one.shape != other.shape or not np.allclose(one, other)


def test_a_given_start_is_where_it_starts() -> None:
    start = (ORIGIN[0] + 9.0, ORIGIN[1] + 1.0)
    route = plan(grid(rooms()), RADIUS, np.random.default_rng(0), start)
    np.testing.assert_allclose(route[0], start, atol=0.1)


def test_a_large_building_is_driven_in_part() -> None:
    hall = np.zeros((40, 4000), dtype=bool)
    hall[[0, -1]], hall[:, [0, -1]] = True, True
    route = plan(grid(hall), RADIUS, np.random.default_rng(0))
    assert np.hypot(*np.diff(route, axis=0).T).sum() < 1.1 * LONGEST


def test_a_wide_way_round_is_preferred_to_a_slit() -> None:
    occupied = np.zeros((80, 160), dtype=bool)
    occupied[[0, -1]], occupied[:, [0, -1, 80]] = True, True
    occupied[40 - 6 : 40 + 6, 80] = False  # 0.6 m wide, straight ahead
    occupied[50:74, 80] = False  # 1.2 m wide, 1 m aside
    start = (ORIGIN[0] + 2.0, ORIGIN[1] + 2.0)
    for seed in range(4):
        route = plan(grid(occupied), RADIUS, np.random.default_rng(seed), start)
        assert route[:, 0].max() > ORIGIN[0] + 4.5  # it does go to the other side
        assert room_along(grid(occupied), driven(route)[::5]).min() > 0.35


def test_clearance_is_to_the_border_of_the_next_cell() -> None:
    occupied = np.zeros((9, 9), dtype=bool)
    occupied[4, 0] = True
    room = clearance(grid(occupied, 0.1))
    assert room[4, 0] == 0.0
    assert room[4, 1] == pytest.approx(0.05)
    assert room[4, 4] == pytest.approx(0.35)
    assert room[8, 4] == pytest.approx(0.05)  # beyond the map nothing is free


NOTHING = np.zeros((60, 60), dtype=bool)
BOX = NOTHING.copy()
BOX[[0, -1]], BOX[:, [0, -1]] = True, True
SLITS = BOX.copy()
SLITS[:, ::8] = True
CELL = BOX.copy()
CELL[14:, :], CELL[:, 14:] = True, True
WALL = BOX.copy()
WALL[30] = True


@pytest.mark.parametrize(
    ("drawn", "start", "message"),
    [
        (grid(NOTHING, unknown=~NOTHING), None, "no free space, expected free cells"),
        (grid(~NOTHING), None, "no free space"),
        (grid(SLITS), None, "no place where the robot fits: the widest free place is 0.3. m across"),
        (grid(CELL), None, "no room to drive: the robot gets no further than 0"),
        (grid(WALL), (ORIGIN[0] + 1.0, ORIGIN[1] + 1.52), r"start \(-2, 3.52\) is inside a wall"),
        (grid(WALL), (ORIGIN[0] + 1.0, ORIGIN[1] + 1.62), "is 0.08 m from what is not free, expected at le"),
        (
            grid(WALL),
            (50.0, 2.0),
            r"start \(50, 2\) is outside of the map, expected x in -3..0 and y in 2..5",
        ),
        (grid(BOX, unknown=WALL & ~BOX), (ORIGIN[0] + 1.0, ORIGIN[1] + 1.52), "is in unknown space"),
    ],
)
def test_where_nobody_can_drive_it_says_why(
    drawn: Grid, start: tuple[float, float] | None, message: str
) -> None:
    with pytest.raises(NoRouteError, match=message) as caught:
        plan(drawn, RADIUS, np.random.default_rng(0), start)
    assert "\n" not in str(caught.value)
