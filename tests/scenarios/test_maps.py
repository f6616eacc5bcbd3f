import numpy as np
import pytest

from scenarios.evaluation.maps import compare, map_metrics, occupied_cells, true_map
from slam import se2
from slam.mapping.occupancy import Grid
from slam.recording import Laser, Recording


def wall(x0: int, n: int = 10, y: int = 0) -> np.ndarray:
    return np.column_stack([np.arange(x0, x0 + n), np.full(n, y)])


def room_recording(truth: np.ndarray | None) -> Recording:
    """Scans of a round room of 3 m radius around the origin, from its centre."""
    n, angles = 4, np.linspace(-np.pi, np.pi, 720, endpoint=False)
    ranges = np.full((n, len(angles)), 3.0)
    return Recording("room", np.arange(n), ranges, angles, Laser(), np.zeros((n, 3)), truth=truth)


def test_equal_maps():
    assert compare(wall(0), wall(0), 0.05) == {"map_f1": 1.0, "map_iou": 1.0, "map_chamfer": 0.0}


def test_a_wall_one_cell_off_is_found():
    result = compare(wall(0, y=1), wall(0), 0.05)
    assert result["map_f1"] == 1.0
    assert result["map_iou"] == pytest.approx(2 / 4)  # three rows each, two of them shared
    assert result["map_chamfer"] == pytest.approx(0.05)


def test_a_wall_two_cells_off_is_not():
    assert compare(wall(0, y=2), wall(0), 0.05)["map_f1"] == 0.0


def test_precision_and_recall_by_hand():
    """Half of the true wall is drawn, and twice as much elsewhere: P = 5/15, R = 6/10 (one by tolerance)."""
    estimate = np.concatenate([wall(0, 5), wall(0, 10, y=50)])
    result = compare(estimate, wall(0, 10), 0.05)
    assert result["map_f1"] == pytest.approx(2 * (5 / 15) * (6 / 10) / (5 / 15 + 6 / 10))


def test_negative_cells_are_cells():
    assert compare(wall(-5, y=-3), wall(-5, y=-3), 0.05)["map_iou"] == 1.0
    assert compare(wall(-5, y=-3), wall(-5, y=3), 0.05)["map_f1"] == 0.0


def test_cells_of_grids_with_different_origins_agree():
    occupied = np.zeros((4, 6), dtype=bool)
    occupied[3, 5] = True
    grid = Grid(occupied, np.zeros_like(occupied), np.array([-0.15, 0.35]), 0.05)
    assert occupied_cells(grid).tolist() == [[2, 10]]


def test_true_poses_draw_the_true_map_in_any_frame():
    truth = np.array([[0.0, 0, 0], [0.3, 0, 0], [0.3, 0.3, 1], [0, 0.3, 2]])
    recording = room_recording(truth)
    grid = true_map(recording)
    metrics = map_metrics(se2.compose([3.0, 1.0, 0.5], truth), recording, grid)
    assert metrics["map_f1"] > 0.99


def test_wrong_poses_draw_a_worse_map():
    truth = np.array([[0.0, 0, 0], [0.3, 0, 0], [0.3, 0.3, 1], [0, 0.3, 2]])
    recording = room_recording(truth)
    wrong = truth * [-2.0, 1.0, 1.0]
    assert map_metrics(wrong, recording, true_map(recording))["map_f1"] < 0.9


def test_without_truth_there_is_a_reason():
    recording = room_recording(None)
    metrics = map_metrics(np.zeros((4, 3)), recording, true_map(recording))
    assert list(metrics.values()) == ["the recording has no truth"] * 3


def test_scans_without_any_return_are_a_reason():
    n = 3
    recording = Recording(
        "fog",
        np.arange(n),
        np.full((n, 2), np.nan),
        np.array([0.0, 0.1]),
        Laser(),
        np.zeros((n, 3)),
        truth=np.zeros((n, 3)),
    )
    metrics = map_metrics(np.zeros((n, 3)), recording, true_map(recording))
    assert set(metrics.values()) == {"no occupied cell to compare"}
