"""What the confidence measures need to be told: weights of their combination, and thresholds."""

from __future__ import annotations

import os
import sys
from dataclasses import dataclass
from itertools import product
from typing import TYPE_CHECKING

from scenarios.ablate.study.likeness import REPORTED
from scenarios.ablate.study.stitching import chosen, seeds_of
from scenarios.catalogue import CATALOGUE
from slam.cli import InputError

if TYPE_CHECKING:
    from scenarios.ablate.segmentation.drive import Steps


@dataclass(frozen=True)
class Options:
    """Learn `slam.odometry.combination` and the thresholds of `slam.odometry.segmentation` from simulated
    drives, and print them.

    Scenarios and seeds are others than those of the segmentation study; every scenario weighs alike.
    """

    scenarios: str = "beehive,corridor,twin_rooms,two_drives"
    """Scenarios of the catalogue, with commas between."""
    seeds: str = "100-111"
    """Seeds: first-last, or numbers with commas between; 100 and above."""
    workers: int = 0
    """Processes; 0 takes a process for each core. The results do not depend on it."""


def run(options: Options) -> None:
    """Drive, fit, and print what is to stand in the code."""
    seeds = seeds_of(options.seeds)
    if min(seeds) in REPORTED:
        raise InputError(f"--seeds {options.seeds!r}: expected seeds from 100 on, the others are reported on")
    if options.workers < 0:
        raise InputError(f"expected --workers >= 0, got {options.workers}")
    scenarios = chosen(options.scenarios, list(CATALOGUE), "scenario")

    from scenarios.ablate.segmentation.learning import fitted, thresholds
    from scenarios.ablate.workers import in_order

    examples: dict[str, list[Steps]] = {name: [] for name in scenarios}
    drives = list(product(scenarios, seeds))
    for (name, seed), steps in zip(
        drives, in_order(observed, drives, options.workers or os.cpu_count() or 1), strict=True
    ):
        print(f"{name} {seed}: {steps.lost.sum()} of {len(steps.error)} steps lost", file=sys.stderr)
        examples[name].append(steps)
    try:
        weights, bias = fitted(examples)
    except ValueError as error:
        raise InputError(f"--seeds {options.seeds}: {error}") from error
    print(f"WEIGHTS = {_literal(weights)}\nBIAS = {bias:.3f}\n")
    print(f"THRESHOLDS = {_literal(thresholds(examples, weights, bias))}")


def observed(drive: tuple[str, int]) -> Steps:
    """The steps of a simulated drive."""
    from scenarios.ablate.segmentation.drive import driven, steps_of

    found = driven(*drive)
    return steps_of(found.recording, found.track)


def _literal(numbers: dict[str, float]) -> str:
    """A dictionary of numbers as Python reads it."""
    lines = [
        f'    "{name}": ' + ("np.inf" if value == float("inf") else f"{value:.4g}") + ","
        for name, value in numbers.items()
    ]
    return "\n".join(["{", *lines, "}"])
