"""What a method that works scan by scan answered on the way, and how long each scan took."""

from __future__ import annotations

import numpy as np

from scenarios.evaluation.metric import Metric, measured, missing
from scenarios.evaluation.trajectory import aligned
from slam.se2 import Array
from stitch.mapping.estimate import OnlineResult

NAMES = ("ate_online", "latency_median", "latency_p99", "latency_max")


def live_metrics(method: str, live: OnlineResult | None, truth: Array | None) -> list[Metric]:
    """Error of the poses as given on the way, and latency [ms]."""
    if live is None:
        return missing(method, NAMES, "the method answers when the drive is over")
    milliseconds = 1e3 * live.seconds
    latency = {
        "latency_median": float(np.median(milliseconds)),
        "latency_p99": float(np.percentile(milliseconds, 99.0)),
        "latency_max": float(milliseconds.max()),
    }
    if truth is None:
        error = missing(method, ("ate_online",), "the recording has no truth")
    else:
        off = aligned(live.poses, truth)[:, :2] - truth[:, :2]
        error = measured(method, {"ate_online": float(np.sqrt(np.mean(np.sum(off**2, axis=1))))})
    return error + measured(method, latency)
