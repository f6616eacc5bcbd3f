from dataclasses import replace

import numpy as np
import pytest

from scenarios.evaluation.relations import (
    ALL,
    AT_SCANS,
    CLEAR,
    DEFINITIONS,
    carry,
    relation_metrics,
    relation_pairs,
    relations_from_stamps,
    relations_from_truth,
)
from slam import se2
from slam.formats import load
from slam.recording import Laser, Odometry, Recording, Relations


def recording(poses, **kwargs):
    n = len(poses)
    time = kwargs.pop("time", np.arange(n, dtype=float))
    return Recording("r", time, np.full((n, 2), np.nan), np.array([0.0, 0.1]), Laser(), poses, **kwargs)


def line(x):
    x = np.asarray(x, dtype=float)
    return np.column_stack([x, 0 * x, 0 * x])


def values(poses, rec):
    return relation_metrics(poses, rec, relation_pairs(rec))


def test_errors_by_hand():
    """Relations of 1 m and 2 m; the estimate is 0.1 m and 0.3 m off, and turned by 0° and 2°."""
    relations = Relations(np.array([[0.0, 1], [1, 2]]), line([1.0, 2.0]))
    rec = recording(line([0, 1, 3]), relations=relations)
    estimate = np.array([[0.0, 0, 0], [1.1, 0, 0], [3.4, 0, np.radians(2)]])
    v = values(estimate, rec)
    assert v["relation_trans_mean"] == pytest.approx(0.2)
    assert v["relation_trans_std"] == pytest.approx(0.1)
    assert v["relation_rot_mean"] == pytest.approx(1.0)
    assert v["relation_rot_std"] == pytest.approx(1.0)


def test_the_frame_of_the_estimate_does_not_matter():
    relations = Relations(np.array([[0.0, 2.0]]), line([2.0]))
    rec = recording(line([0, 1, 2]), relations=relations)
    moved = se2.compose([4.0, -3.0, 2.0], line([0, 1, 2.5]))
    assert values(moved, rec)["relation_trans_mean"] == pytest.approx(0.5)


def test_relations_of_a_file_are_between_poses_of_the_laser():
    """The robot turns on the spot; the laser, 0.5 m ahead of its middle, comes to (0, 0.5) from (0.5, 0)."""
    relations = Relations(np.array([[0.0, 1.0]]), np.array([[-0.5, 0.5, np.pi / 2]]))
    turned = np.array([[0.0, 0, 0], [0, 0, np.pi / 2]])
    rec = recording(turned, relations=relations).with_laser_mount([0.5, 0.0, 0.0])
    assert values(turned, rec)["relation_trans_mean"] == pytest.approx(0.0, abs=1e-12)
    assert values(turned, rec.with_laser_mount([0.0, 0.0, 0.0]))["relation_trans_mean"] > 0.7


def test_correction_is_spread_along_the_path_between_scans():
    """Odometry at 0, 1, 4 m with scans at 0 and 4 m; the scans turn out 4.4 m apart."""
    odometry = Odometry(np.array([0.0, 1, 2]), line([0, 1, 4]), np.array([0, 2]))
    np.testing.assert_allclose(carry(line([0, 4.4]), odometry), line([0, 1.1, 4.4]), atol=1e-12)


def test_a_turn_on_the_spot_takes_its_share_of_the_correction():
    odometry = Odometry(np.arange(3.0), np.array([[0.0, 0, 0], [0, 0, 0.5], [0, 0, 1.0]]), np.array([0, 2]))
    np.testing.assert_allclose(
        carry(np.array([[0.0, 0, 0], [0, 0, 1.2]]), odometry)[:, 2], [0, 0.6, 1.2], atol=1e-12
    )


def test_before_the_first_scan_and_after_the_last_odometry_carries_alone():
    odometry = Odometry(np.arange(4.0), line([0, 1, 2, 3]), np.array([1, 2]))
    np.testing.assert_allclose(carry(line([11, 13]), odometry), line([10, 11, 13, 14]), atol=1e-12)


def test_carrying_keeps_the_poses_at_the_scans():
    rng = np.random.default_rng(0)
    odometry = Odometry(np.arange(30.0), rng.normal(0, 2, (30, 3)), np.array([3, 9, 10, 27]))
    poses = rng.normal(0, 2, (4, 3))
    at_scans = carry(poses, odometry)[odometry.scan_row]
    np.testing.assert_allclose(se2.between(at_scans, poses), 0.0, atol=1e-9)


def test_stamps_mean_the_nearest_record_even_when_time_goes_backwards():
    odometry = Odometry(np.array([0.0, 2.0, 1.0, 3.0]), line([0, 1, 2, 3]), np.array([0]))
    pairs = relations_from_stamps(Relations(np.array([[0.05, 0.95], [2.1, 3.0]]), line([1, 1])), odometry)
    assert pairs.rows.tolist() == [[0, 2], [1, 3]]


def test_relations_too_far_from_any_record_are_left_out():
    odometry = Odometry(np.arange(3.0), line([0, 1, 2]), np.array([0]))
    pairs = relations_from_stamps(Relations(np.array([[0.0, 1.13], [0.0, 1.11]]), line([1, 7])), odometry)
    assert pairs.rows.tolist() == [[0, 1]]
    assert pairs.T_12[0, 0] == 7


def test_relations_that_match_nothing_are_an_error():
    odometry = Odometry(np.arange(3.0), line([0, 1, 2]), np.array([0]))
    with pytest.raises(ValueError, match="none of the 1 relations") as error:
        relations_from_stamps(Relations(np.array([[100.0, 101]]), line([1])), odometry)
    assert "\n" not in str(error.value)


def test_clear_relations_have_no_second_record_near():
    odometry = Odometry(np.array([0.0, 1.0, 1.009, 2.0, 2.011]), line([0, 1, 1.5, 2, 2]), np.array([0]))
    stamps = np.array([[0.0, 1.0], [0.0, 2.0]])
    pairs = relations_from_stamps(Relations(stamps, line([1, 2])), odometry)
    assert pairs.clear.tolist() == [False, True]


def test_no_clear_relation_is_a_reason():
    relations = Relations(np.array([[0.0, 1.0]]), line([1]))
    rec = recording(line([0, 1, 1]), time=np.array([0.0, 1.0, 1.001]), relations=relations)
    metrics = relation_metrics(line([0, 1, 1]), rec, relation_pairs(rec))
    assert metrics["relation_trans_mean"] == 0.0
    assert metrics["relation_clear_trans_mean"] == "every relation has an ambiguous stamp"


def test_relations_at_scans_need_no_pose_that_is_carried():
    """Five records, scans at the first, third and last of them; the estimate is 0.5 m off at the third."""
    odometry = Odometry(np.arange(5.0), line([0, 1, 2, 3, 4]), np.array([0, 2, 4]))
    relations = Relations(np.array([[0.0, 2], [0, 1], [2, 3], [0, 4]]), line([2, 1, 1, 4]))
    rec = recording(line([0, 2, 4]), odometry=odometry, relations=relations, time=np.array([0.0, 2, 4]))
    assert relation_pairs(rec).at_scans.tolist() == [True, False, False, True]
    v = values(line([0, 2.5, 4]), rec)
    assert v["relation_at_scans_trans_mean"] == pytest.approx(0.25)
    assert v["relation_trans_mean"] == pytest.approx((0.5 + 0.25 + 0.25 + 0.0) / 4)
    between = replace(rec, relations=Relations(np.array([[1.0, 3.0]]), line([2])))
    assert (
        values(line([0, 2, 4]), between)["relation_at_scans_rot_std"]
        == "no relation has both stamps at scans"
    )


def test_truth_gives_consecutive_relations_and_revisits():
    """Out 6 m and back in 1 m steps: the last scans are near the first ones again."""
    truth = line([0, 1, 2, 3, 4, 5, 6, 5, 4, 3, 2, 1, 0.5])
    rows = relations_from_truth(truth).rows.tolist()
    assert rows[:12] == [[i, i + 1] for i in range(12)]
    assert rows[12:] == [[0, 11], [0, 12], [1, 12]]


def test_revisits_are_thinned_alike_every_time():
    angle = np.linspace(0, 20 * np.pi, 2000)
    truth = np.column_stack([3 * np.cos(angle), 3 * np.sin(angle), angle])
    first, second = relations_from_truth(truth), relations_from_truth(truth)
    assert len(first.rows) <= 2 * len(truth)
    assert len(first.rows) > 1.5 * len(truth)
    np.testing.assert_array_equal(first.rows, second.rows)


def test_true_poses_fulfil_the_relations_from_truth():
    truth = np.random.default_rng(1).normal(0, 3, (50, 3))
    v = values(truth, recording(truth, truth=truth))
    assert all(v[name] == pytest.approx(0.0, abs=1e-6) for name in ALL)


def test_relations_from_truth_have_no_ambiguous_stamps():
    truth = line([0, 1, 2])
    rec = recording(truth, truth=truth)
    metrics = relation_metrics(truth, rec, relation_pairs(rec))
    assert len(CLEAR) == 4
    assert {metrics[name] for name in CLEAR} == {"relations made from truth have no ambiguous stamps"}
    assert {metrics[name] for name in AT_SCANS} == {"relations made from truth are all between scans"}


def test_neither_relations_nor_truth_is_a_reason():
    rec = recording(line([0, 1]))
    metrics = relation_metrics(line([0, 1]), rec, relation_pairs(rec))
    assert metrics.keys() == DEFINITIONS.keys()
    assert all(isinstance(reason, str) for reason in metrics.values())


@pytest.fixture(scope="module")
def intel(shared_data):
    return load(shared_data / "carmen/intel.raw.log.gz", shared_data / "carmen/intel.relations")


def test_raw_odometry_on_intel_scores_as_published(intel):
    v = values(intel.dead_reckoning, intel)
    assert v["relation_trans_mean"] == pytest.approx(7.383, abs=5e-4)
    assert v["relation_trans_std"] == pytest.approx(14.341, abs=5e-4)


def test_gmapping_on_intel_scores_as_published(intel, shared_data):
    poses = np.loadtxt(shared_data / "carmen/intel.gmapping_ref.txt")[:, 1:4]
    v = values(poses, intel)
    assert v["relation_trans_mean"] == pytest.approx(0.0447, abs=1e-4)
    assert v["relation_clear_trans_mean"] == pytest.approx(0.0278, abs=1e-4)
    assert v["relation_clear_trans_std"] == pytest.approx(0.0198, abs=5e-4)
