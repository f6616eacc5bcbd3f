"""What each meeting of two walls says of an alignment, learnt from pairs whose truth is known."""

from __future__ import annotations

import zlib
from dataclasses import dataclass
from itertools import chain, product
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro

from scenarios.ablate.study.stitching import chosen, seeds_of
from scenarios.catalogue import CATALOGUE
from scenarios.sweep import Answer, Trial, check, finish, sweep
from slam.cli import InputError

REPORTED = range(100)
"""Seeds that results are reported on: nothing is learnt from them."""


@dataclass(frozen=True)
class Options:
    """Learn the weights of `stitch.alignment.likelihood` from simulated pairs of submaps, and print them.

    Every alignment that the search of a pair leads to is an example, right or wrong within the limits of the
    stitching study. Furniture is moved in every building, in two of three besides the pairs in which it is
    not. Logistic regression on the square roots of the counts, with an L2 penalty; then the constant that a
    prior adds.
    """

    scenarios: str = "hospital,beehive,office_smoke,two_drives"
    """Scenarios of the catalogue, with commas between; twin_rooms would teach the wrong thing."""
    seeds: str = "200-211"
    """Seeds: first-last, or numbers with commas between; 100 and above."""
    workers: int = 0
    """Processes; 0 takes a process for each core. The results do not depend on it."""
    scheduler: Annotated[str | None, tyro.conf.arg(metavar="tcp://HOST:PORT")] = None
    """A running Dask scheduler whose workers do the trials, instead of processes of this machine."""
    out: Annotated[Path, tyro.conf.arg(aliases=["-o"])] = Path("runs/ablate-likeness")
    """A folder for sweep.sqlite, from which a sweep that was interrupted goes on."""
    fresh: bool = False
    """Forget the trials that the folder holds and run them again."""


def run(options: Options) -> None:
    """Harvest the buildings, fit, and print the table of weights as it stands in the code."""
    seeds = seeds_of(options.seeds)
    if min(seeds) in REPORTED:
        raise InputError(f"--seeds {options.seeds!r}: expected seeds from 100 on, the others are reported on")
    check(options.scheduler, options.workers, options.out)
    scenarios = chosen(options.scenarios, list(CATALOGUE), "scenario")

    from scenarios.ablate.examples import Examples, fit, fit_guided

    store = options.out / "sweep.sqlite"
    swept = sweep(
        [Trial("likeness", name, seed, "joint") for name, seed in product(scenarios, seeds)],
        examples,
        store,
        scheduler=options.scheduler,
        workers=options.workers,
        fresh=options.fresh,
    )
    both = [Examples.unpacked(found.payload, 2) for _, found in swept.answered]
    alone, guided = [free for free, _ in both], [told for _, told in both]
    free, told = Examples.together(alone), Examples.together(guided)
    if not free.right.any() or free.right.all():
        raise InputError(f"--seeds {options.seeds}: expected right and wrong alignments, found one kind only")
    weights, gaps, bias = fit(free)
    by_prior = fit_guided(told, weights, gaps, bias)
    print(f"{len(free.right)} alignments without a prior, {free.right.sum()} of them right")
    print(f"{len(told.right)} alignments with a prior, {told.right.sum()} of them right\n")
    print(f"WEIGHTS = np.array(\n{_literal(weights)}\n)\nGAPS = np.array({_literal(gaps)})")
    print(f"BIAS, PRIOR_BONUS = {bias:.2f}, {by_prior:.2f}")
    finish(swept, store)


def _literal(numbers: np.ndarray) -> str:
    """Numbers as Python reads them."""
    return np.array2string(numbers, precision=2, separator=", ", suppress_small=True, floatmode="fixed")


def examples(trial: Trial, nothing: None) -> Answer:
    """Alignments of all pairs of a building, without a prior and with one, as the payload."""
    from scenarios.ablate.examples import Examples
    from scenarios.ablate.harvesting import both_ways
    from scenarios.ablate.trial import drawn_prior
    from stitch.alignment.config import AlignConfig

    alone, guided = [], []
    for k, pair in enumerate(chain(*both_ways(trial.scenario, trial.seed))):
        rng = np.random.default_rng([pair.seed, zlib.crc32(pair.scenario.encode()), 4, k])
        alone.append(Examples.of_pair(pair, None, AlignConfig()))
        guided.append(Examples.of_pair(pair, drawn_prior(pair.T_a_b, rng), AlignConfig()))
    free, told = Examples.together(alone), Examples.together(guided)
    return Answer([{"alone": len(free.right), "guided": len(told.right)}], Examples.packed([free, told]))
