import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from scenarios.evaluation.trajectory import (
    align,
    aligned,
    relative_errors,
    trajectory_metrics,
    travelled_pairs,
)
from slam import se2


def drive(seed: int, n: int = 400) -> tuple[np.ndarray, np.ndarray]:
    """A wandering truth and an estimate that drifts from it, in another frame."""
    rng = np.random.default_rng(seed)
    steps = np.stack([rng.uniform(0, 0.2, n), rng.normal(0, 0.01, n), rng.normal(0, 0.15, n)], -1)
    truth, estimate = [np.array([1.0, -2.0, 0.3])], [np.array([5.0, 4.0, 2.0])]
    for step in steps:
        truth.append(se2.compose(truth[-1], step))
        estimate.append(se2.compose(estimate[-1], step + rng.normal(0, [0.01, 0.01, 0.005])))
    return np.array(truth), np.array(estimate)


def values(poses, truth):
    return trajectory_metrics(poses, truth)


coordinate = st.floats(-50, 50)


@given(coordinate, coordinate, st.floats(-3.1, 3.1))
def test_alignment_recovers_any_rigid_motion(x, y, yaw):
    truth, _ = drive(0, 20)
    T = np.array([x, y, yaw])
    moved = se2.compose(se2.inverse(T), truth)
    np.testing.assert_allclose(se2.between(T, align(moved, truth)), 0.0, atol=1e-9)


def test_alignment_does_not_scale():
    truth = np.array([[-1.0, 0, 0], [1, 0, 0]])
    np.testing.assert_allclose(aligned(truth * [3, 3, 1], truth), truth * [3, 3, 1], atol=1e-12)


def test_alignment_of_a_robot_that_stood_still_takes_the_heading():
    truth = np.tile([1.0, 2.0, 0.5], (4, 1))
    np.testing.assert_allclose(aligned(np.tile([0.0, 0.0, -0.25], (4, 1)), truth), truth, atol=1e-12)


@pytest.mark.parametrize("bad", [np.zeros((3, 3)), np.zeros((4, 2)), np.full((4, 3), np.nan)])
def test_alignment_refuses_what_is_not_the_same_drive(bad):
    with pytest.raises(ValueError, match="alignment"):
        align(bad, np.zeros((4, 3)))


def test_absolute_errors_by_hand():
    """A square whose corners are pushed outwards by 0.1 m: nothing to align, every error is 0.1 m."""
    corners = np.array([[1.0, 1], [-1, 1], [-1, -1], [1, -1]])
    truth = np.column_stack([corners, np.zeros(4)])
    estimate = np.column_stack([corners * (1 + 0.1 / np.sqrt(2)), np.radians([3.0, -3, 3, -3])])
    v = values(estimate, truth)
    assert v["ate_rmse"] == pytest.approx(0.1)
    assert v["ate_median"] == pytest.approx(0.1)
    assert v["ate_max"] == pytest.approx(0.1)
    assert v["yaw_rmse"] == pytest.approx(3.0)


def test_anchored_error_by_hand():
    """Driven 1 and 2 m straight on, a quarter turn wrong from the start: off by √2 and 2√2 m."""
    truth = np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0]])
    estimate = np.array([[7.0, 7, 0], [7, 8, 0], [7, 9, 0]])
    v = values(estimate, truth)
    assert v["ate_rmse_anchored"] == pytest.approx(np.sqrt((0 + 2 + 8) / 3))
    assert v["ate_rmse"] == pytest.approx(0.0, abs=1e-12)


def test_heading_error_wraps():
    truth = np.array([[0.0, 0, 3.13], [1, 0, 3.13]])
    estimate = np.array([[0.0, 0, -3.13], [1, 0, -3.13]])
    assert values(estimate, truth)["yaw_rmse"] == pytest.approx(np.degrees(2 * np.pi - 6.26))


def test_pairs_are_the_nearest_in_travelled_distance_and_near_enough():
    x = np.array([0.0, 0.5, 0.95, 1.02, 1.55, 2.0, 2.0])
    truth = np.column_stack([x, 0 * x, 0 * x])
    assert travelled_pairs(truth, 1.0).tolist() == [[0, 3], [1, 4], [2, 5], [3, 5]]


def test_relative_error_by_hand():
    """10 % too much distance and one degree of yaw per metre."""
    s = np.arange(0.0, 12.0)
    truth = np.column_stack([s, 0 * s, 0 * s])
    stretched = np.column_stack([1.1 * s, 0 * s, 0 * s])
    v = values(stretched, truth)
    assert v["rpe_trans_1m"] == pytest.approx(0.1)
    assert v["rpe_trans_10m"] == pytest.approx(np.sqrt((1.0**2 + 1.0**2 + 0.9**2) / 3))  # the last is 9 m
    assert v["rpe_rot_10m"] == pytest.approx(0.0, abs=1e-9)
    turned = np.column_stack([s, 0 * s, np.radians(s)])
    assert values(turned, truth)["rpe_rot_1m"] == pytest.approx(1.0)


def test_a_short_drive_has_no_ten_metre_window():
    truth = np.column_stack([np.arange(4.0), np.zeros(4), np.zeros(4)])
    metrics = trajectory_metrics(truth, truth)
    assert metrics["rpe_trans_10m"] == "no two scans lie 10 m of driving apart"
    assert metrics["rpe_trans_1m"] == 0.0


def test_without_truth_every_metric_is_there_with_a_reason():
    truth, estimate = drive(1, 50)
    with_truth = trajectory_metrics(estimate, truth)
    without = trajectory_metrics(estimate, None)
    assert list(without) == list(with_truth)
    assert set(without.values()) == {"the recording has no truth"}


def evo_path(poses):
    trajectory = pytest.importorskip("evo.core.trajectory", reason="evo is not installed")
    matrices = np.tile(np.eye(4), (len(poses), 1, 1))
    matrices[:, :2, :2] = se2.rotation(poses[:, 2])
    matrices[:, :2, 3] = poses[:, :2]
    return trajectory.PosePath3D(poses_se3=list(matrices))


@pytest.mark.parametrize("seed", range(4))
def test_absolute_errors_agree_with_evo(seed):
    truth, estimate = drive(seed)
    reference, path = evo_path(truth), evo_path(estimate)
    from evo.core.metrics import APE, PoseRelation

    path.align(reference, correct_scale=False)
    v = values(estimate, truth)
    ape = APE(PoseRelation.translation_part)
    ape.process_data((reference, path))
    statistics = ape.get_all_statistics()
    assert v["ate_rmse"] == pytest.approx(statistics["rmse"], abs=1e-9)
    assert v["ate_median"] == pytest.approx(statistics["median"], abs=1e-9)
    assert v["ate_max"] == pytest.approx(statistics["max"], abs=1e-9)
    ape = APE(PoseRelation.rotation_angle_deg)
    ape.process_data((reference, path))
    assert v["yaw_rmse"] == pytest.approx(ape.get_all_statistics()["rmse"], abs=1e-9)


@pytest.mark.parametrize("length", [1, 10])
@pytest.mark.parametrize("seed", range(2))
def test_relative_errors_agree_with_evo(seed, length):
    truth, estimate = drive(seed)
    reference, path = evo_path(truth), evo_path(estimate)
    from evo.core.metrics import RPE, PoseRelation, Unit

    v = values(estimate, truth)
    for relation, name in (
        (PoseRelation.translation_part, "trans"),
        (PoseRelation.rotation_angle_deg, "rot"),
    ):
        rpe = RPE(relation, delta=length, delta_unit=Unit.meters, all_pairs=True, pairs_from_reference=True)
        rpe.process_data((reference, path))
        assert v[f"rpe_{name}_{length}m"] == pytest.approx(rpe.get_all_statistics()["rmse"], abs=1e-9)
        ours = relative_errors(estimate, truth, travelled_pairs(truth, length))
        np.testing.assert_allclose(ours[0] if name == "trans" else np.degrees(ours[1]), rpe.error, atol=1e-9)
