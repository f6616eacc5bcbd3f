"""The grid says what the beams saw, and nothing about what they did not."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest

from slam import se2
from slam.mapping.occupancy import Grid, draw
from slam.mapping.ray_tracing import count
from slam.recording import Laser

LASER = Laser(range_max=20.0)
FAN = np.radians(np.arange(-180.0, 180.0, 0.5))


def in_room(poses: np.ndarray, angles: np.ndarray, half: float = 3.0) -> np.ndarray:
    """Ranges to the walls of a square room about the origin."""
    bearing = poses[:, 2:] + angles
    c, s = np.cos(bearing), np.sin(bearing)
    x, y = poses[:, :1], poses[:, 1:2]
    with np.errstate(divide="ignore"):
        return np.minimum((np.sign(c) * half - x) / c, (np.sign(s) * half - y) / s)


def test_one_beam_by_hand() -> None:
    grid = draw(np.array([[0.5, 0.5, 0.0]]), np.array([[3.0]]), np.array([0.0]), LASER, 1.0)
    assert grid.free.tolist() == [[True, True, True, False]]
    assert grid.occupied.tolist() == [[False, False, False, True]]
    assert grid.origin.tolist() == [0.0, 0.0]
    assert grid.occupied_points().tolist() == [[3.5, 0.5]]
    assert grid.extent == (0.0, 4.0, 0.0, 1.0)


def test_rows_are_y_and_columns_are_x() -> None:
    grid = draw(np.array([[0.5, 0.5, np.pi / 2]]), np.array([[2.0]]), np.array([0.0]), LASER, 1.0)
    assert grid.occupied.shape == (3, 1)
    assert grid.occupied_points().tolist() == [[0.5, 2.5]]


def test_origin_is_on_the_lattice_and_negative_coordinates_round_down() -> None:
    grid = draw(np.array([[-0.37, -0.81, 0.2]]), np.array([[1.0]]), np.array([0.0]), LASER, 0.05)
    np.testing.assert_allclose(grid.origin / 0.05, np.round(grid.origin / 0.05), atol=1e-9)
    assert np.all(grid.origin <= [-0.37, -0.81])
    assert np.all(grid.origin > [-0.42, -0.86])


def test_the_mount_moves_the_beam() -> None:
    laser = Laser(range_max=20.0, T_robot_laser=np.array([0.0, 1.0, np.pi / 2]))
    grid = draw(np.array([[0.5, 0.5, 0.0]]), np.array([[2.0]]), np.array([0.0]), laser, 1.0)
    assert grid.occupied_points().tolist() == [[0.5, 3.5]]


def test_kernel_agrees_with_an_exact_slow_twin() -> None:
    """The twin clips every ray against every cell."""
    rng = np.random.default_rng(0)
    starts = rng.uniform(2.0, 28.0, (20, 2))
    ends = rng.uniform(0.0, 30.0, (20, 15, 2))
    ends[3, 4] = np.nan
    hits, passes = np.zeros((30, 30), int), np.zeros((30, 30), int)
    low = np.stack(np.meshgrid(np.arange(30), np.arange(30)), -1)
    for start, row in zip(starts, ends, strict=True):
        for end in row[np.isfinite(row[:, 0])]:
            t = np.sort([(low - start) / (end - start), (low + 1 - start) / (end - start)], axis=0)
            crossed = np.maximum(t[0].max(-1), 0.0) < np.minimum(t[1].min(-1), 1.0)
            crossed[int(end[1]), int(end[0])] = False
            hits[int(end[1]), int(end[0])] += 1
            passes += crossed
    fast_hits, fast_passes = count(starts, ends, np.zeros(2), (30, 30))
    np.testing.assert_array_equal(fast_hits, hits)
    np.testing.assert_array_equal(fast_passes, passes)


def test_walls_stand_and_nothing_is_free_behind_them() -> None:
    rng = np.random.default_rng(1)
    poses = np.column_stack([rng.uniform(-2.5, 2.5, (30, 2)), rng.uniform(-np.pi, np.pi, 30)])
    ranges = in_room(poses, FAN) + rng.normal(0.0, 0.01, (30, len(FAN)))
    grid = draw(poses, ranges, FAN, LASER, 0.05)
    centres = grid.origin[0] + (np.arange(grid.free.shape[1]) + 0.5) * 0.05
    outside = np.abs(centres) > 3.0 + 0.05
    assert not grid.free[:, outside].any()
    assert not grid.free[outside].any()
    inside = np.abs(centres) < 3.0 - 0.1
    assert grid.free[np.ix_(inside, inside)].all()
    walls = grid.occupied.sum()
    assert np.all(np.abs(np.abs(grid.occupied_points()).max(axis=1) - 3.0) < 0.1)
    assert walls > 4 * 6.0 / 0.05 * 0.98


def test_a_wall_survives_grazing_beams() -> None:
    """Seen from far down a corridor, many beams cross a wall's cells just before they hit the next ones."""
    poses = np.column_stack([np.arange(0.0, 2.0, 0.1), np.full(20, 0.02), np.zeros(20)])
    angles = np.radians(np.arange(3.0, 60.0, 0.25))
    ranges = (1.03 - poses[:, 1:2]) / np.sin(angles)
    grid = draw(poses, ranges, angles, LASER, 0.05)
    wall = grid.occupied[int((1.03 - grid.origin[1]) / 0.05)]
    x = grid.origin[0] + (np.arange(len(wall)) + 0.5) * 0.05
    assert wall[(x > 2.5) & (x < 8.0)].mean() > 0.95


@pytest.mark.parametrize("slope", [0.0, 1e-12, 1e-4, 0.01, 0.05, 1.0, 1.0 + 1e-12])
@pytest.mark.parametrize("offset", [0.0, 1e-12, 0.25])
def test_a_grazing_ray_passes_only_cells_it_touches(slope: float, offset: float) -> None:
    """Along borders, through corners and nearly so: against a twin that asks each cell if it is touched.

    A ray on a border belongs to one of its two sides; it must not jump to a third.
    """
    start = np.array([2.0, 3.0 + offset])
    for turn in range(4):
        c, s = round(np.cos(turn * np.pi / 2)), round(np.sin(turn * np.pi / 2))
        along = np.array([[c, -s], [s, c]]) @ np.array([17.3, 17.3 * slope])
        origin, end = start + 20.0, start + 20.0 + along
        hits, passes = count(origin[None], end[None, None], np.zeros(2), (50, 50))
        touched = _touched(origin, end, 50)
        assert not np.any((passes + hits > 0) & ~touched)
        steps = np.abs(np.floor(end) - np.floor(origin)).sum()
        assert passes.sum() == steps
        assert hits[int(end[1]), int(end[0])] == 1


def _touched(a: np.ndarray, b: np.ndarray, size: int) -> np.ndarray:
    """Cells whose closed square the segment from a to b meets, within rounding."""
    low = np.stack(np.meshgrid(np.arange(size), np.arange(size)), -1).astype(float)
    enter, leave = np.zeros((size, size)), np.ones((size, size))
    for axis in (0, 1):
        step = b[axis] - a[axis]
        near, far = low[..., axis] - 1e-9 - a[axis], low[..., axis] + 1.0 + 1e-9 - a[axis]
        if abs(step) < 1e-300:
            leave = np.where((near > 0.0) | (far < 0.0), -1.0, leave)
            continue
        first, last = np.minimum(near / step, far / step), np.maximum(near / step, far / step)
        enter, leave = np.maximum(enter, first), np.minimum(leave, last)
    return enter <= leave


def test_nothing_is_free_behind_a_wall_seen_at_grazing_incidence() -> None:
    """A bare corridor, askew to the grid, seen along its length with beams down to 0.2° off its walls."""
    corridor = np.array([0.0, 0.0, np.radians(7.3)])
    half = 1.013
    x = np.linspace(0.0, 6.0, 40)
    local = np.column_stack([x, 0.9 * half * np.sin(3.0 * x), np.zeros(40)])
    beams = np.radians(np.concatenate([np.arange(-60.0, -0.1, 0.2), np.arange(0.2, 60.1, 0.2)]))
    ranges = (np.sign(beams) * half - local[:, 1:2]) / np.sin(beams)
    grid = draw(se2.compose(corridor, local), ranges, beams, LASER, 0.05)
    rows, columns = np.nonzero(grid.free)
    centres = grid.origin + (np.stack([columns, rows], -1) + 0.5) * grid.resolution
    beyond = np.abs(se2.transform(se2.inverse(corridor), centres)[:, 1]) - half
    assert beyond.max() < 0.05 * np.sqrt(0.5)  # a cell that reaches into the corridor, no farther
    walls = se2.transform(se2.inverse(corridor), grid.occupied_points())
    assert np.abs(np.abs(walls[:, 1]) - half).max() < 0.05


def test_what_has_moved_away_is_free() -> None:
    poses = np.tile([0.5, 0.5, 0.0], (30, 1))
    ranges = np.full((30, 1), 8.0)
    ranges[:2] = 3.0
    grid = draw(poses, ranges, np.array([0.0]), LASER, 1.0)
    assert grid.free[0, 3]
    assert grid.occupied_points().tolist() == [[8.5, 0.5]]
    assert draw(poses, ranges, np.array([0.0]), LASER, 1.0, min_share=0.01).occupied[0, 3]


def test_a_single_hit_can_be_too_few() -> None:
    one = (np.array([[0.5, 0.5, 0.0]]), np.array([[3.0]]), np.array([0.0]), LASER, 1.0)
    grid = draw(*one, min_hits=2)
    assert not grid.occupied.any()
    assert not grid.free[0, 3]  # nor was it seen through


@pytest.mark.parametrize("nothing", [np.nan, np.inf, 25.0, 0.05])
def test_a_beam_without_return_clears_nothing(nothing: float) -> None:
    grid = draw(np.array([[0.5, 0.5, 0.0]]), np.array([[nothing]]), np.array([0.0]), LASER, 1.0)
    assert grid.occupied.shape == (1, 1)
    assert not grid.free.any()
    assert not grid.occupied.any()
    assert grid.occupied_points().shape == (0, 2)


@pytest.mark.parametrize(
    ("poses", "ranges", "complaint"),
    [
        ([[np.nan, 0.0, 0.0]], [[1.0]], "finite poses"),
        ([[0.0, 0.0, 0.0]], [[1.0, 2.0]], "expected ranges"),
        ([], np.zeros((0, 1)), "at least one pose"),
        ([[0.0, 0.0, 0.0], [1e6, 1e6, 0.0]], [[1.0], [1.0]], "too large"),
    ],
)
def test_refused(poses: list, ranges: list, complaint: str) -> None:
    with pytest.raises(ValueError, match=complaint) as error:
        draw(np.array(poses), np.array(ranges), np.array([0.0]), LASER)
    assert "\n" not in str(error.value)


def test_grid_refuses_masks_of_different_shape() -> None:
    with pytest.raises(ValueError, match="one \\(H, W\\)"):
        Grid(np.zeros((2, 2), bool), np.zeros((2, 3), bool), np.zeros(2), 0.05)


def test_importing_stays_light() -> None:
    code = "import sys, slam.mapping.occupancy, stitch; print({'numba', 'scipy'} & set(sys.modules))"
    shown = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert shown.stdout.strip() == "set()"
