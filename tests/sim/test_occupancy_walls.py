"""Walls from occupancy maps: drawn shapes whose outlines are known."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sim.floorplan import wall_lines, walls_of_map
from sim.laser import Raycaster
from sim.terrain import Terrain
from sim.world import World
from slam.mapping.occupancy import Grid
from slam.se2 import Array

RESOLUTION, ORIGIN = 0.05, np.array([-3.0, 2.0])


def grid(occupied: np.ndarray) -> Grid:
    return Grid(occupied, ~occupied, ORIGIN, RESOLUTION)


def distances(points: Array, segments: Array) -> Array:
    """Distance (n,) of points (n, 2) to the nearest of segments (S, 4)."""
    a, along = segments[:, :2], segments[:, 2:] - segments[:, :2]
    towards = points[:, None] - a
    length = np.maximum(np.sum(along**2, axis=1), 1e-12)
    share = np.clip(np.sum(towards * along, axis=2) / length, 0.0, 1.0)
    return np.linalg.norm(towards - share[..., None] * along, axis=2).min(axis=1)


def building(seed: int, thickness: int) -> np.ndarray:
    """Outer walls, slanted inner walls with a gap, and pillars."""
    rng = np.random.default_rng(seed)
    image = np.zeros((160, 220), dtype=np.uint8)
    cv2.rectangle(image, (5, 5), (214, 154), 1, thickness)
    for _ in range(5):
        (x1, y1), (x2, y2) = rng.integers(10, 150, (2, 2))
        cv2.line(image, (int(x1), int(y1)), (int(x2), int(y2)), 1, thickness)
    for x, y in rng.integers(10, 150, (6, 2)):
        image[y : y + 4, x : x + 4] = 1
    image[40, 200] = 1
    return image.astype(bool)


@settings(max_examples=8, deadline=None)
@given(st.integers(0, 10_000), st.integers(1, 3))
def test_wall_cells_lie_on_the_outlines(seed: int, thickness: int) -> None:
    drawn = grid(building(seed, thickness))
    world = World(tuple(walls_of_map(drawn)), Terrain.level(ORIGIN, ORIGIN + 6.0))
    away = distances(drawn.occupied_points(), world.outlines(0.3)) / RESOLUTION
    assert np.median(away) < 1.0
    assert np.percentile(away, 95) < 2.0


@settings(max_examples=8, deadline=None)
@given(st.integers(0, 10_000), st.integers(1, 3))
def test_there_is_no_wall_where_nothing_is_drawn(seed: int, thickness: int) -> None:
    drawn = grid(building(seed, thickness))
    ends = wall_lines(drawn)
    share = np.linspace(0.0, 1.0, 50)[:, None, None]
    along = ((1 - share) * ends[:, :2] + share * ends[:, 2:]).reshape(-1, 2)
    occupied = drawn.occupied_points()
    nearest = np.array([np.hypot(*(occupied - point).T).min() for point in along[::7]])
    assert nearest.max() < 1.5 * RESOLUTION


def test_a_straight_wall_is_one_box_as_thick_as_a_cell() -> None:
    occupied = np.zeros((20, 40), dtype=bool)
    occupied[7, 10:30] = True
    (only,) = walls_of_map(grid(occupied), height=2.0)
    np.testing.assert_allclose(only.footprint.min(axis=0), ORIGIN + np.array([10, 7]) * RESOLUTION)
    np.testing.assert_allclose(only.footprint.max(axis=0), ORIGIN + np.array([30, 8]) * RESOLUTION)
    assert (only.kind, only.z_hi) == ("wall", 2.0)


def test_a_lone_cell_is_a_post() -> None:
    occupied = np.zeros((5, 5), dtype=bool)
    occupied[2, 3] = True
    (only,) = walls_of_map(grid(occupied))
    np.testing.assert_allclose(only.footprint.min(axis=0), ORIGIN + np.array([3, 2]) * RESOLUTION)
    np.testing.assert_allclose(only.footprint.max(axis=0), ORIGIN + np.array([4, 3]) * RESOLUTION)


def test_nothing_occupied_is_no_walls() -> None:
    assert walls_of_map(grid(np.zeros((5, 5), dtype=bool))) == []


@pytest.mark.parametrize("thickness", [1, 3])
def test_a_laser_in_the_room_measures_to_the_faces_of_the_cells(thickness: int) -> None:
    occupied = np.ones((61, 101), dtype=bool)
    inside = slice(thickness, -thickness)
    occupied[inside, inside] = False
    drawn = grid(occupied)
    world = World(tuple(walls_of_map(drawn)), Terrain.level(ORIGIN, ORIGIN + 6.0))
    centre = ORIGIN + 0.5 * RESOLUTION * np.array([101, 61])
    ranges = Raycaster(world).cast([[*centre, 0.0]], np.array([0.0, 0.5, 1.0, 1.5]) * np.pi)[0]
    expected = [50.5 - thickness, 30.5 - thickness, 50.5 - thickness, 30.5 - thickness]
    np.testing.assert_allclose(ranges, np.array(expected) * RESOLUTION, atol=1e-9)
