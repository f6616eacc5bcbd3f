"""What each meeting of two walls says of an alignment, learnt from pairs whose truth is known."""

from __future__ import annotations

import os
import sys
import zlib
from dataclasses import dataclass
from itertools import product
from typing import TYPE_CHECKING

import numpy as np

from scenarios.ablate.study.stitching import PER_BUILDING, chosen, seeds_of
from scenarios.catalogue import CATALOGUE
from scenarios.cli import BadInput

if TYPE_CHECKING:
    from scenarios.ablate.examples import Examples

REPORTED = range(100)
"""Seeds that results are reported on: nothing is learnt from them."""


@dataclass(frozen=True)
class Options:
    """Learn the weights of `stitch.likeness` from simulated pairs of submaps, and print them.

    Every alignment that the search of a pair leads to is an example, right or wrong within the limits of the
    stitching study. Logistic regression on the square roots of the counts, with an L2 penalty; then the
    constant that a prior adds.
    """

    scenarios: str = "hospital,beehive,office_smoke,two_drives"
    """Scenarios of the catalogue, with commas between; twin_rooms would teach the wrong thing."""
    seeds: str = "200-211"
    """Seeds: first-last, or numbers with commas between; 100 and above."""
    workers: int = 0
    """Processes; 0 takes a process for each core. The results do not depend on it."""


def run(options: Options) -> None:
    """Harvest the buildings, fit, and print the table of weights as it stands in the code."""
    seeds = seeds_of(options.seeds)
    if min(seeds) in REPORTED:
        raise BadInput(f"--seeds {options.seeds!r}: expected seeds from 100 on, the others are reported on")
    if options.workers < 0:
        raise BadInput(f"expected --workers >= 0, got {options.workers}")
    scenarios = chosen(options.scenarios, list(CATALOGUE), "scenario")

    from scenarios.ablate.examples import Examples, fit, fit_guided
    from scenarios.ablate.workers import in_order

    alone, guided = [], []
    workers = options.workers or os.cpu_count() or 1
    for name, seed, free, told in in_order(examples, list(product(scenarios, seeds)), workers):
        print(f"{name} {seed}: {len(free.right)} and {len(told.right)} alignments", file=sys.stderr)
        alone.append(free)
        guided.append(told)
    free, told = Examples.together(alone), Examples.together(guided)
    if not free.right.any() or free.right.all():
        raise BadInput(f"--seeds {options.seeds}: expected right and wrong alignments, found one kind only")
    weights, bias = fit(free)
    print(f"{len(free.right)} alignments without a prior, {free.right.sum()} of them right")
    print(f"{len(told.right)} alignments with a prior, {told.right.sum()} of them right\n")
    table = np.array2string(weights, precision=2, separator=", ", suppress_small=True, floatmode="fixed")
    print(
        f"WEIGHTS = np.array(\n{table}\n)\nBIAS, GUIDED = {bias:.2f}, {fit_guided(told, weights, bias):.2f}"
    )


def examples(building: tuple[str, int]) -> tuple[str, int, Examples, Examples]:
    """Alignments of all pairs of a building (scenario, seed), without a prior and with one."""
    from scenarios.ablate.examples import Examples
    from scenarios.ablate.pairs import harvest
    from scenarios.ablate.trial import drawn_prior
    from stitch.config import AlignConfig

    name, seed = building
    alone, guided = [], []
    for k, pair in enumerate(harvest(CATALOGUE[name], seed, PER_BUILDING).pairs):
        rng = np.random.default_rng([pair.seed, zlib.crc32(pair.scenario.encode()), 4, k])
        alone.append(Examples.of_pair(pair, None, AlignConfig()))
        guided.append(Examples.of_pair(pair, drawn_prior(pair.T_a_b, rng), AlignConfig()))
    return name, seed, Examples.together(alone), Examples.together(guided)
