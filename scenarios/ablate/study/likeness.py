"""What each meeting of two walls says of an alignment, learnt from pairs whose truth is known."""

from __future__ import annotations

from itertools import chain, product

import numpy as np

from scenarios.ablate.options import LikenessOptions
from scenarios.ablate.pair_sampling import training_pairs
from scenarios.ablate.study.stitching import draw_prior
from scenarios.ablate.training import CountedAlignments, fit_likelihood, fit_prior_offset, require
from scenarios.ablate.trial_io import stream
from scenarios.sweep import Answer, Trial, finish
from slam.cli import InputError
from stitch.alignment.config import AlignConfig


def run(options: LikenessOptions) -> None:
    """Sample the pairs, fit, and print the table of weights as it stands in the code."""
    scenarios, seeds = options.checked_for_training()
    require()
    trials = [Trial("likeness", name, seed, "joint") for name, seed in product(scenarios, seeds)]
    swept = options.sweep(trials, collect_alignments)
    parts = [CountedAlignments.from_bytes(result.payload) for _, result in swept.answered]
    known = CountedAlignments.concat([CountedAlignments.empty(), *parts])
    unguided, guided = known.where(~known.guided), known.where(known.guided)
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
    parts, config = [CountedAlignments.empty()], AlignConfig()
    for k, pair in enumerate(chain(*training_pairs(trial.scenario, trial.seed))):
        prior = draw_prior(pair.T_a_b, stream(pair.seed, pair.scenario, "priors", k))
        parts += [CountedAlignments.of_pair(pair, one, config) for one in (None, prior)]
    return Answer([], CountedAlignments.concat(parts).to_bytes())
