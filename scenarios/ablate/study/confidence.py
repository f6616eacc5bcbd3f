"""What the confidence measures need to be told: weights of their combination, and thresholds."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from scenarios.options import StudyOptions
from scenarios.sweep import Answer, Trial, finish
from slam.cli import InputError

if TYPE_CHECKING:
    from scenarios.ablate.segmentation.drive import LabelledDrive


@dataclass(frozen=True)
class Options(StudyOptions):
    """Learn `slam.odometry.combination` and the thresholds of `slam.odometry.segmentation` from simulated
    drives, and print them.

    Scenarios and seeds are others than those of the segmentation study; every scenario weighs alike. Needs
    the extra [train].
    """

    scenarios: str = "beehive,corridor,twin_rooms,two_drives"
    """Scenarios of the catalogue, with commas between."""
    seeds: str = "100-111"
    """Seeds: first-last, or numbers with commas between; 100 and above."""
    out: Annotated[Path, tyro.conf.arg(aliases=["-o"])] = Path("runs/ablate-confidence")
    """A folder for sweep.sqlite, from which a sweep that was interrupted goes on."""


def run(options: Options) -> None:
    """Drive, fit, and print what is to stand in the code."""
    scenarios, seeds = options.checked_for_training()

    from scenarios.ablate.classifiers import require
    from scenarios.ablate.segmentation.drive import Steps, label_drive
    from scenarios.ablate.segmentation.learning import fit_combination, learn_thresholds

    require()
    trials = [Trial("confidence", name, seed, "wsm") for name, seed in product(scenarios, seeds)]
    swept = options.sweep(trials, measure_steps, prepare=label_drive)
    examples: dict[str, list[Steps]] = {name: [] for name in scenarios}
    for trial, result in swept.answered:
        steps = Steps.from_bytes(result.payload)
        lost = f"{steps.lost.sum()} of {len(steps.error)} steps lost"
        print(f"{trial.scenario} {trial.seed}: {lost}", file=sys.stderr)
        examples[trial.scenario].append(steps)
    try:
        weights, bias = fit_combination(examples)
    except ValueError as error:
        raise InputError(f"--seeds {options.seeds}: {error}") from error
    print(f"WEIGHTS = {_literal(weights)}\nBIAS = {bias:.3f}\n")
    print(f"THRESHOLDS = {_literal(learn_thresholds(examples, weights, bias))}")
    finish(swept, options.store)


def measure_steps(trial: Trial, drive: LabelledDrive) -> Answer:
    """The steps of a simulated drive, as the payload."""
    from scenarios.ablate.segmentation.drive import steps_of

    return Answer([], steps_of(drive.recording, drive.track).to_bytes())


def _literal(numbers: dict[str, float]) -> str:
    """A dictionary of numbers as Python reads it."""
    lines = [
        f'    "{name}": ' + ("np.inf" if value == float("inf") else f"{value:.4g}") + ","
        for name, value in numbers.items()
    ]
    return "\n".join(["{", *lines, "}"])
