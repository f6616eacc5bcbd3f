"""What each meeting of two walls says of an alignment, learnt from pairs whose truth is known."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import chain, product
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro

from scenarios.options import StudyOptions
from scenarios.sweep import Answer, Trial, finish
from slam.cli import InputError


@dataclass(frozen=True)
class Options(StudyOptions):
    """Learn the weights of `stitch.alignment.likelihood` from simulated pairs of submaps, and print them.

    Every candidate of the search of a pair is an example, right or wrong within the limits of the stitching
    study. Furniture is moved in every building, in two of three besides the pairs in which it is not.
    Logistic regression on the square roots of the counts, with an L2 penalty; then the constant that a prior
    adds. Needs the extra [train].
    """

    scenarios: str = "hospital,beehive,office_smoke,two_drives"
    """Scenarios of the catalogue, with commas between; twin_rooms would teach the wrong thing."""
    seeds: str = "200-211"
    """Seeds: first-last, or numbers with commas between; 100 and above."""
    out: Annotated[Path, tyro.conf.arg(aliases=["-o"])] = Path("runs/ablate-likeness")
    """A folder for sweep.sqlite, from which a sweep that was interrupted goes on."""


def run(options: Options) -> None:
    """Sample the pairs, fit, and print the table of weights as it stands in the code."""
    scenarios, seeds = options.checked_for_training()

    from scenarios.ablate.classifiers import require
    from scenarios.ablate.training_set import CountedAlignments, fit_likelihood, fit_prior_offset

    require()
    trials = [Trial("likeness", name, seed, "joint") for name, seed in product(scenarios, seeds)]
    swept = options.sweep(trials, collect_alignments)
    empty = CountedAlignments.empty()
    parts = [(empty, empty), *(CountedAlignments.unpack(result.payload) for _, result in swept.answered)]
    unguided, guided = (CountedAlignments.concat(several) for several in zip(*parts, strict=True))
    if not unguided.right.any() or unguided.right.all():
        raise InputError(f"--seeds {options.seeds}: expected right and wrong alignments, found one kind only")
    weights, gaps, bias = fit_likelihood(unguided)
    offset = fit_prior_offset(guided, weights, gaps, bias)
    print(f"{len(unguided.right)} alignments without a prior, {unguided.right.sum()} of them right")
    print(f"{len(guided.right)} alignments with a prior, {guided.right.sum()} of them right\n")
    print(f"WEIGHTS = np.array(\n{_literal(weights)}\n)\nGAPS = np.array({_literal(gaps)})")
    print(f"BIAS, PRIOR_BONUS = {bias:.2f}, {offset:.2f}")
    finish(swept, options.store)


def _literal(numbers: np.ndarray) -> str:
    """Numbers as Python reads them."""
    return np.array2string(numbers, precision=2, separator=", ", suppress_small=True, floatmode="fixed")


def collect_alignments(trial: Trial, nothing: None) -> Answer:
    """Candidates of all pairs of a building, without a prior and with one, as the payload."""
    from scenarios.ablate.pair_sampling import training_pairs
    from scenarios.ablate.random_streams import stream
    from scenarios.ablate.stitching_trials import draw_prior
    from scenarios.ablate.training_set import CountedAlignments
    from stitch.alignment.config import AlignConfig

    unguided, guided, config = [CountedAlignments.empty()], [CountedAlignments.empty()], AlignConfig()
    for k, pair in enumerate(chain(*training_pairs(trial.scenario, trial.seed))):
        prior = draw_prior(pair.T_a_b, stream(pair.seed, pair.scenario, "priors", k))
        unguided.append(CountedAlignments.of_pair(pair, None, config))
        guided.append(CountedAlignments.of_pair(pair, prior, config))
    both = [CountedAlignments.concat(several) for several in (unguided, guided)]
    numbers = {"alone": len(both[0].right), "guided": len(both[1].right)}
    return Answer([numbers], CountedAlignments.pack(both))
