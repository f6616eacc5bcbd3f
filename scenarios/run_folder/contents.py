"""What a finished run consists of."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from scenarios.evaluation import Metric
from slam.recording import Recording
from stitch.mapping.estimate import Estimate

if TYPE_CHECKING:
    from sim.record import SimulatedRun


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
