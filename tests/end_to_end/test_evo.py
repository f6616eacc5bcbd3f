"""evo, from the files of a run, comes to our numbers."""

from __future__ import annotations

import copy
import json

import pytest

METHODS = ["ins", "icp", "wsm", "htms", "slamstitch"]
TOLERANCE = 1e-9


@pytest.fixture(scope="module")
def ours(done):
    metrics = json.loads((done.folder / "metrics.json").read_text())["metrics"]
    return {(m["method"], m["metric"]): m["value"] for m in metrics}


@pytest.fixture(params=METHODS)
def method(request):
    return request.param


@pytest.fixture
def pair(method, done):
    """True and estimated trajectory, as evo reads them."""
    from evo.core.sync import associate_trajectories
    from evo.tools.file_interface import read_tum_trajectory_file

    folder = done.folder / "trajectories"
    truth, estimate = (read_tum_trajectory_file(folder / f"{name}.tum") for name in ("truth", method))
    return associate_trajectories(truth, estimate)


def statistics(metric, pair):
    from evo.core.metrics import StatisticsType

    metric.process_data(pair)
    return {kind.value: metric.get_statistic(kind) for kind in StatisticsType}


def test_absolute_errors_after_alignment(method, pair, ours):
    from evo.core.metrics import APE, PoseRelation

    truth, estimate = pair[0], copy.deepcopy(pair[1])
    rotation, _, _ = estimate.align(truth, correct_scale=False)
    position = statistics(APE(PoseRelation.translation_part), (truth, estimate))
    heading = statistics(APE(PoseRelation.rotation_angle_deg), (truth, estimate))
    if rotation[2, 2] < 0.0:  # evo aligns in space: it has turned a path over whose mirror image fits better
        assert method == "htms"
        assert ours[method, "ate_rmse"] > position["rmse"]
        return
    assert ours[method, "ate_rmse"] == pytest.approx(position["rmse"], abs=TOLERANCE)
    assert ours[method, "ate_median"] == pytest.approx(position["median"], abs=TOLERANCE)
    assert ours[method, "ate_max"] == pytest.approx(position["max"], abs=TOLERANCE)
    assert ours[method, "yaw_rmse"] == pytest.approx(heading["rmse"], abs=1e-6)  # evo's goes through acos


def test_absolute_errors_in_the_frame_of_the_first_pose(method, pair, ours):
    from evo.core.metrics import APE, PoseRelation

    truth, estimate = pair[0], copy.deepcopy(pair[1])
    estimate.align_origin(truth)
    position = statistics(APE(PoseRelation.translation_part), (truth, estimate))
    assert ours[method, "ate_rmse_anchored"] == pytest.approx(position["rmse"], abs=TOLERANCE)


@pytest.mark.parametrize("length", [1, 10])
def test_relative_errors(method, length, pair, ours):
    from evo.core.metrics import RPE, PoseRelation, Unit

    windows = {"delta": length, "delta_unit": Unit.meters, "all_pairs": True, "pairs_from_reference": True}
    translation = statistics(RPE(PoseRelation.translation_part, **windows), pair)
    rotation = statistics(RPE(PoseRelation.rotation_angle_deg, **windows), pair)
    assert ours[method, f"rpe_trans_{length}m"] == pytest.approx(translation["rmse"], abs=TOLERANCE)
    assert ours[method, f"rpe_rot_{length}m"] == pytest.approx(rotation["rmse"], abs=1e-6)
