"""The trials of the study: every method on every drive, clean and spoilt in every way at every severity."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from scenarios import source
from scenarios.corruptions import corrupted, parse_corruptions
from scenarios.evaluation import evaluate
from scenarios.methods import METHODS, load_kernels
from scenarios.methods.config import MethodConfig
from scenarios.methods.warm_up import warm_up_recording
from scenarios.run_folder.directory import fingerprint
from scenarios.source import Source
from scenarios.stages import timed
from scenarios.sweep import Answer, Trial
from sim.corruption import CORRUPTIONS
from slam.cli import InputError
from slam.odometry.laser_mount import is_mount_unstated
from slam.recording import Recording
from stitch.mapping import NoEstimate

STUDY = "robustness"


@dataclass(frozen=True)
class Log:
    """A recording that is read: its file, and that of its relations if it has any."""

    path: Path
    relations: Path | None = None

    @classmethod
    def checked(cls, path: Path, relations: Path | None) -> Log:
        """A log that can be read and scored. Raises `InputError`."""
        recording = source.logged(path, relations, None).recording
        if recording.truth is None and recording.relations is None:
            raise InputError(f"--logs {path}: has no truth, expected its relations (--relations)")
        return cls(path, relations)

    @property
    def mark(self) -> str:
        """What tells it and its relations from all others."""
        return "".join(fingerprint(path) for path in (self.path, self.relations) if path is not None)


@dataclass(frozen=True)
class Spoiling:
    """What is done to a recording: a ``corruption`` as the command line has it, at a ``level`` that has a
    name; empty for the clean recording. ``drawn``: chance has a part in it."""

    corruption: str = ""
    level: str = ""
    drawn: bool = True


def spoilings(kinds: Sequence[str], levels: Sequence[str]) -> list[Spoiling]:
    """The clean recording, then every kind at the levels; one that is there or not counts at every level."""
    found = [Spoiling(drawn=False)]
    for name in kinds:
        kind = CORRUPTIONS[name]
        for level, corruption in kind.levels():
            if level in ("", *levels):
                found.append(Spoiling(str(corruption), level, kind.drawn))
    return found


def trials(
    scenarios: Sequence[str],
    logs: Mapping[str, Log],
    seeds: Sequence[int],
    spoilt: Sequence[Spoiling],
    methods: Sequence[str],
) -> Iterator[Trial]:
    """Every drive spoilt in every way for every method. A log is the same whatever the seed: it is spoilt
    again by each only where chance has a part in it."""
    for scenario in (*scenarios, *logs):
        marked = {"log": logs[scenario].mark} if scenario in logs else {}
        for seed in seeds:
            for how in spoilt:
                if scenario in logs and not how.drawn and seed != seeds[0]:
                    continue
                config = {"corruption": how.corruption, "level": how.level, **marked}
                yield from (Trial(STUDY, scenario, seed, method, config) for method in methods)


def load_drive(scenario: str, seed: int, logs: Mapping[str, Log]) -> Recording:
    """The clean recording of a scenario and seed, or of one of the ``logs`` by name."""
    if scenario not in logs:
        return source.simulated(scenario, seed).recording
    return source.logged(logs[scenario].path, logs[scenario].relations, None).recording


def run_trial(trial: Trial, clean: Recording) -> Answer:
    """One row: the method's metrics on the spoilt drive, and its processor time [s] without loading kernels;
    or that it ``refused`` to answer, or that the recording is ``unfit``: it lacks what would be spoilt."""
    config, words = MethodConfig(), [trial.config["corruption"]] if trial.config["corruption"] else []
    try:
        recording = corrupted(clean, parse_corruptions(words), trial.seed)
    except InputError as error:
        return Answer([_row(unfit=str(error))])
    if is_mount_unstated(recording):
        recording = source.with_estimated_mount(Source(recording, {}), config.slam)[0].recording
    load_kernels(trial.method, warm_up_recording(recording), config)
    estimate, seconds = timed(METHODS[trial.method], recording, config)
    if isinstance(estimate, NoEstimate):
        return Answer([_row(refused=estimate.reason, seconds=seconds)])
    metrics = evaluate(recording, [estimate])
    values = {metric.name: metric.value for metric in metrics if metric.value is not None}
    return Answer([_row(values=values, seconds=seconds)])


def _row(**known: Any) -> dict[str, Any]:
    return {"values": {}, "seconds": float("nan"), "refused": "", "unfit": ""} | known
