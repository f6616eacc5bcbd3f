import math

import pytest

from scenarios.evaluation import DEFINITIONS, cost, missing, to_metrics
from scenarios.evaluation.metric import Metric


def test_json_of_a_value_has_no_reason():
    (metric,) = to_metrics("wsm", {"ate_rmse": 0.31})
    assert metric.to_json() == {
        "method": "wsm",
        "metric": "ate_rmse",
        "value": 0.31,
        "unit": "m",
        "better": "lower",
    }


def test_json_of_a_missing_value_is_null_with_its_reason():
    (metric,) = missing("wsm", ("map_f1",), "the recording has no truth")
    assert metric.to_json() == {
        "method": "wsm",
        "metric": "map_f1",
        "value": None,
        "unit": "",
        "better": "higher",
        "reason": "the recording has no truth",
    }


@pytest.mark.parametrize(
    ("value", "reason"), [(None, None), (1.0, "why"), (math.nan, None), (math.inf, None)]
)
def test_a_metric_is_either_a_finite_value_or_a_reason(value, reason):
    with pytest.raises(ValueError, match="metric ate_rmse"):
        Metric("ate_rmse", value, "m", "lower", reason, "wsm")


def test_cost_by_hand():
    values = {m.name: m.value for m in cost("wsm", wall_s=2.0, scans=100, peak_mb=512.0)}
    assert values == {"wall_s": 2.0, "scans_per_s": 50.0, "peak_mb": 512.0}


def test_cost_that_was_not_measured_says_so():
    metrics = {m.name: m for m in cost("wsm", wall_s=0.0, scans=100, peak_mb=None)}
    assert metrics["scans_per_s"].value is None
    assert metrics["peak_mb"].reason == "peak memory was not measured"


@pytest.mark.parametrize("name", DEFINITIONS)
def test_every_metric_says_what_it_means_and_what_it_cannot_see(name):
    definition = DEFINITIONS[name]
    assert definition.meaning
    assert definition.cannot_see.endswith(".")
    assert definition.better in ("lower", "higher", None)
