"""Maps laid over each other, cell by cell."""

from __future__ import annotations

import numpy as np
import pytest

from slam.mapping.occupancy import Grid
from stitch.command.merge import canvas, merge, place


def grid_of(picture: str, resolution: float = 0.5, origin: tuple[float, float] = (0.0, 0.0)) -> Grid:
    """Rows from the top: # occupied, . free, _ unknown."""
    cells = np.array([list(row) for row in picture.split()[::-1]])
    return Grid(cells == "#", cells == ".", np.array(origin), resolution)


def picture_of(grid: Grid) -> list[str]:
    cells = np.where(grid.occupied, "#", np.where(grid.free, ".", "_"))
    return ["".join(row) for row in cells[::-1]]


def together(a: Grid, b: Grid, T_a_b: tuple[float, float, float], resolution: float = 0.5) -> Grid:
    poses = [np.zeros(3), np.array(T_a_b)]
    onto = canvas([a, b], poses, resolution)
    return merge([place(grid, T, onto) for grid, T in zip([a, b], poses, strict=True)])


def test_shifted_by_whole_cells():
    a = grid_of("###  #..  #..", origin=(1.0, 2.0))
    b = grid_of("##  .#  _#")
    whole = together(a, b, (2.0, 2.5, 0.0))
    assert picture_of(whole) == ["__##", "####", "#..#", "#.._"]
    assert whole.origin.tolist() == [1.0, 2.0]


def test_turned_by_a_right_angle():
    b = grid_of("#..  ##.")
    assert picture_of(together(grid_of("."), b, (1.0, 0.0, np.pi / 2))) == ["..", ".#", "##"]


def test_a_coarse_map_on_fine_cells_has_no_holes():
    whole = together(grid_of("#", 0.25), grid_of("##  ._", 0.5), (0.25, 0.0, 0.0), 0.25)
    assert picture_of(whole) == ["_####", "_####", "_..__", "#..__"]


def test_a_wall_stays_where_the_maps_contradict_each_other():
    assert picture_of(together(grid_of("#.."), grid_of("..#"), (0.0, 0.0, 0.0))) == ["#.#"]


@pytest.mark.parametrize("yaw", np.radians([17.0, 45.0, -121.0]))
def test_a_thin_wall_stays_connected_at_any_angle(yaw):
    from scipy.ndimage import label

    occupied = np.zeros((40, 40), dtype=bool)
    occupied[20, 3:37] = True
    whole = together(grid_of("."), Grid(occupied, ~occupied, np.zeros(2), 0.5), (3.1, -2.7, yaw))
    _, pieces = label(whole.occupied, structure=np.ones((3, 3)))
    assert pieces == 1
    assert 30 <= whole.occupied.sum() <= 34


def test_only_room_for_what_is_known():
    grid = grid_of("___  _#_  ___")
    assert canvas([grid], [np.zeros(3)], 0.5).extent == (0.5, 1.0, 0.5, 1.0)


def test_maps_too_far_apart_are_refused():
    with pytest.raises(ValueError, match=r"a merged map of .* cells is too large, at most 100,000,000 cells"):
        canvas([grid_of("#"), grid_of("#")], [np.zeros(3), np.array([1e4, 1e4, 0.0])], 0.5)
