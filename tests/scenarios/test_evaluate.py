import numpy as np
import pytest

from scenarios.evaluation import DEFINITIONS, cost, evaluate
from slam.recording import Laser, Recording, Relations
from stitch.mapping.estimate import Estimate


@pytest.fixture
def recording():
    n, angles = 30, np.linspace(-1.5, 1.5, 61)
    truth = np.column_stack([0.1 * np.arange(n), np.zeros(n), np.zeros(n)])
    ranges = np.tile(2.0 + np.cos(3 * angles), (n, 1))
    return Recording("r", np.arange(n), ranges, angles, Laser(), truth.copy(), truth=truth)


def test_every_method_gets_every_metric_once_in_the_order_of_the_table(recording):
    estimates = [Estimate(name, recording.truth) for name in ("ins", "gmapping (published)")]
    metrics = evaluate(recording, estimates)
    for estimate in estimates:
        names = [m.name for m in metrics if m.method == estimate.method]
        names += [m.name for m in cost(estimate.method, 1.0, 30, 1.0)]
        assert names == list(DEFINITIONS)


def test_perfect_poses_score_perfectly(recording):
    v = {m.name: m.value for m in evaluate(recording, [Estimate("x", recording.truth)])}
    assert v["ate_rmse"] == pytest.approx(0.0, abs=1e-12)
    assert v["map_f1"] == 1.0
    assert v["map_chamfer"] == 0.0
    assert v["relation_trans_mean"] == pytest.approx(0.0, abs=1e-12)


def test_an_estimate_needs_one_pose_per_scan(recording):
    with pytest.raises(ValueError, match=r"icp: expected poses \(30, 3\), got \(29, 3\)"):
        evaluate(recording, [Estimate("icp", recording.truth[:-1])])


def test_relations_of_another_recording_are_refused(recording):
    foreign = recording.with_relations(Relations(np.array([[1e9, 1e9 + 1]]), np.zeros((1, 3))))
    with pytest.raises(ValueError, match="none of the 1 relations"):
        evaluate(foreign, [Estimate("x", recording.truth)])
