"""One simulated drive, every contestant's answer to it, and what the truth says of that."""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from scenarios.ablate.contestants import Contestant
from scenarios.sweep import Answer, Failure, Trial

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


def recorded(scenario: str, seed: int) -> Recording:
    """The drive of a scenario's name and seed."""
    from scenarios.source import simulated

    return simulated(scenario, seed).recording


def trial_of(scenario: str, seed: int, contestant: Contestant) -> Trial:
    """One contestant on one drive, as a trial of the study."""
    settings = {"method": contestant.method, "back_end": contestant.back_end, "injected": contestant.injected}
    return Trial("methods", scenario, seed, contestant.name, settings)


def answer(trial: Trial, recording: Recording) -> Answer:
    """A trial's contestant on its drive: one row, its metrics and seconds."""
    values, seconds = measured(recording, Contestant(trial.method, **trial.config), trial.seed)
    return Answer([{"values": values, "seconds": seconds}])


def drive_of(trial: Trial, found: Answer | Failure) -> Drive:
    """What a trial came to, as a row of the study."""
    if isinstance(found, Failure):
        return Drive(trial.scenario, trial.seed, trial.method, error=found.line)
    (row,) = found.rows
    return Drive(trial.scenario, trial.seed, trial.method, **row)


def measured(recording: Recording, contestant: Contestant, seed: int) -> tuple[dict[str, float], float]:
    """Metrics of a contestant's answer, and its processor time [s]; loading its kernels is not on its
    bill."""
    from scenarios.evaluation import evaluate
    from scenarios.evaluation.consistency import last_squared_error
    from scenarios.methods import METHODS, REHEARSED_AS
    from scenarios.methods.warm_up import warm_up_recording

    config = contestant.config(seed)
    METHODS[REHEARSED_AS.get(contestant.method, contestant.method)](warm_up_recording(recording), config)
    started = time.process_time()
    estimate = METHODS[contestant.method](recording, config)
    seconds = time.process_time() - started
    metrics = evaluate(recording, [estimate])
    values = {metric.name: metric.value for metric in metrics if metric.value is not None}
    if recording.truth is not None:
        values[LAST] = last_squared_error(estimate.poses, estimate.covariance, recording.truth)
    return values, seconds
