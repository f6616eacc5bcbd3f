"""The methods of the methods study, as they are or with another back end or false stitches injected, and one
trial of them: a drive, the method's estimate, and its metrics."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from scenarios.ablate.injection import map_with_false_stitches
from scenarios.methods import METHODS, OURS, load_kernels
from scenarios.methods.config import MethodConfig
from scenarios.sweep import Answer, Failure, Trial
from slam.graph.pose_graph import Loss
from stitch.mapping import NoEstimate

if TYPE_CHECKING:
    from slam.recording import Recording
    from stitch.mapping import Estimate

DEFAULT_BACK_END: Loss = "gnc"
LAST = "nees_last"
"""Besides the metrics by their names: the squared error of the last pose over its covariance."""


@dataclass(frozen=True)
class MethodVariant:
    """A method under the ``name`` that tables call it by.

    ``back_end`` and the share of stitches ``injected`` are read by our method only; ``clean`` names the same
    variant without injection, None where nothing is injected.
    """

    name: str
    method: str
    back_end: Loss = DEFAULT_BACK_END
    injected: float = 0.0
    clean: str | None = None

    def config(self) -> MethodConfig:
        """The method's settings."""
        default = MethodConfig()
        loops = replace(default.slam.loops, back_end=self.back_end)
        return replace(default, slam=replace(default.slam, loops=loops))

    def run(self, recording: Recording, seed: int) -> Estimate | NoEstimate:
        """What the method says of a drive; ``seed`` draws what is injected."""
        if self.injected > 0.0:
            rng = np.random.default_rng(seed)
            return map_with_false_stitches(recording, self.config().slam, self.injected, rng)
        return METHODS[self.method](recording, self.config())

    def trial(self, scenario: str, seed: int) -> Trial:
        """The variant on one drive, as a trial of the study."""
        settings = {"method": self.method, "back_end": self.back_end, "injected": self.injected}
        return Trial("methods", scenario, seed, self.name, settings)


def method_variants(
    methods: Sequence[str], back_ends: Sequence[Loss], injected: float
) -> tuple[MethodVariant, ...]:
    """Every method; ours with each back end, and again with a share of ``injected`` false stitches if any."""
    variants = []
    for method in methods:
        if method != OURS:
            variants.append(MethodVariant(method, method))
            continue
        for back_end in back_ends:
            name = OURS if back_end == DEFAULT_BACK_END else f"{OURS} {back_end}"
            variants.append(MethodVariant(name, OURS, back_end))
            if injected > 0.0:
                variants.append(MethodVariant(f"{name} +{injected:.0%}", OURS, back_end, injected, name))
    return tuple(variants)


@dataclass(frozen=True)
class DriveResult:
    """One variant on one drive: the metrics that could be computed, by name, and ``seconds`` of processor
    time; ``error`` tells what went wrong, and is empty where nothing did."""

    scenario: str
    seed: int
    method: str
    values: dict[str, float] = field(default_factory=dict)
    seconds: float = float("nan")
    error: str = ""

    @classmethod
    def of(cls, trial: Trial, outcome: Answer | Failure) -> DriveResult:
        """What a trial came to."""
        if isinstance(outcome, Failure):
            return cls(trial.scenario, trial.seed, trial.method, error=outcome.line)
        (row,) = outcome.rows
        return cls(trial.scenario, trial.seed, trial.method, **row)

    @property
    def name(self) -> str:
        """The drive, as tables call it."""
        return f"{self.scenario} {self.seed}"

    def value(self, name: str) -> float:
        """A metric, NaN where there is none."""
        return self.values.get(name, float("nan"))


def simulate_recording(scenario: str, seed: int) -> Recording:
    """The recording of a scenario's name and seed."""
    from scenarios.source import simulated

    return simulated(scenario, seed).recording


def run_trial(trial: Trial, recording: Recording) -> Answer:
    """A trial's variant on its drive: one row, its metrics and processor time [s] without loading kernels."""
    from scenarios.evaluation import evaluate
    from scenarios.evaluation.consistency import last_squared_error
    from scenarios.methods.warm_up import warm_up_recording

    variant = MethodVariant(trial.method, **trial.config)
    load_kernels(variant.method, warm_up_recording(recording), variant.config())
    started = time.process_time()
    estimate = variant.run(recording, trial.seed)
    seconds = time.process_time() - started
    if isinstance(estimate, NoEstimate):
        raise ValueError(f"{estimate.method}: {estimate.reason}")
    metrics = evaluate(recording, [estimate])
    values = {metric.name: metric.value for metric in metrics if metric.value is not None}
    if recording.truth is not None:
        values[LAST] = last_squared_error(estimate.poses, estimate.covariance, recording.truth)
    return Answer([{"values": values, "seconds": seconds}])
