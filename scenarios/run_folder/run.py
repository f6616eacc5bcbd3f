"""A finished run: what is written into its folder."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from scenarios.evaluation.metric import Metric
from slam.recording import Recording
from stitch.mapping.estimate import Estimate

if TYPE_CHECKING:
    from sim.record import SimulatedRun

SCHEMA = 1
"""Version of the layout of metrics.json."""


@dataclass(frozen=True)
class Run:
    """What was ``asked`` (command line and every parameter), on what machine, and what came out."""

    asked: Mapping[str, object]
    environment: Mapping[str, object]
    seed: int
    recording: Recording
    estimates: Sequence[Estimate]
    metrics: Sequence[Metric]
    simulated: SimulatedRun | None = None

    def metrics_json(self) -> str:
        """The content of metrics.json."""
        content = {
            "schema": SCHEMA,
            "recording": self.recording.name,
            "seed": self.seed,
            "scans": len(self.recording),
            "distance_m": round(self.recording.distance, 3),
            "metrics": [metric.to_json() for metric in self.metrics],
        }
        return json.dumps(content, indent=1, allow_nan=False)
