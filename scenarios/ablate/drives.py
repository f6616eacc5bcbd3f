"""One simulated drive, every contestant's answer to it, and what the truth says of that."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from scenarios.ablate.contestants import Contestant

if TYPE_CHECKING:
    from slam.recording import Recording

LAST = "nees_last"
"""Besides the metrics by their names: the squared error of the last pose over its covariance."""


@dataclass(frozen=True)
class Drive:
    """One contestant on one drive: the metrics that could be computed, by name, and ``seconds`` of processor
    time; ``error`` tells what went wrong, and is empty where nothing did."""

    scenario: str
    seed: int
    method: str
    values: dict[str, float] = field(default_factory=dict)
    seconds: float = float("nan")
    error: str = ""

    @property
    def name(self) -> str:
        """The drive, as tables call it."""
        return f"{self.scenario} {self.seed}"

    def value(self, name: str) -> float:
        """A metric, NaN where there is none."""
        return self.values.get(name, float("nan"))


def driven(building: tuple[str, int], contestants: Sequence[Contestant]) -> tuple[Drive, ...]:
    """All contestants on the drive of a scenario's name and seed, simulated once. Errors are rows too."""
    from scenarios.source import simulated

    scenario, seed = building
    try:
        recording = simulated(scenario, seed).recording
    except Exception as error:  # whatever it was, the other drives go on
        return tuple(Drive(scenario, seed, one.name, error=told(error)) for one in contestants)
    return tuple(attempt(recording, scenario, seed, one) for one in contestants)


def attempt(recording: Recording, scenario: str, seed: int, contestant: Contestant) -> Drive:
    """One contestant's answer and its metrics, or the error that it raised."""
    try:
        values, seconds = measured(recording, contestant, seed)
    except Exception as error:  # the others go on
        return Drive(scenario, seed, contestant.name, error=told(error))
    return Drive(scenario, seed, contestant.name, values, seconds)


def measured(recording: Recording, contestant: Contestant, seed: int) -> tuple[dict[str, float], float]:
    """Metrics of a contestant's answer, and its processor time [s]; loading its kernels is not on its
    bill."""
    from scenarios.evaluation import evaluate
    from scenarios.evaluation.consistency import last_squared_error
    from scenarios.methods import METHODS, REHEARSED_AS
    from scenarios.rehearsal import rehearsal

    config = contestant.config(seed)
    METHODS[REHEARSED_AS.get(contestant.method, contestant.method)](rehearsal(recording), config)
    started = time.process_time()
    estimate = METHODS[contestant.method](recording, config)
    seconds = time.process_time() - started
    metrics = evaluate(recording, [estimate])
    values = {metric.name: metric.value for metric in metrics if metric.value is not None}
    if recording.truth is not None:
        values[LAST] = last_squared_error(estimate.poses, estimate.covariance, recording.truth)
    return values, seconds


def told(error: Exception) -> str:
    """An error in one line."""
    return f"{type(error).__name__}: {' '.join(str(error).split())}"
