"""How far an alignment may be believed, learnt from pairs whose truth is known."""

from __future__ import annotations

import numpy as np

from scenarios.ablate.options import BeliefOptions
from scenarios.ablate.pair_sampling import BINS, STRANGERS, negative_pairs, training_pairs
from scenarios.ablate.training import Dataset, collect_samples, cross_validate, fit_network, require
from scenarios.sweep import Answer, Trial, finish
from slam.cli import InputError
from slam.table import Table, number

LENGTHS = ((20.0, 40.0), (30.0, 60.0))
"""Distances driven for the shortest and the longest submap [m]: smaller and larger ones are learnt from."""
LIMITS = (-1.0, -0.5, 0.0, 0.3, 0.6, 1.0, 1.5, 2.0)
"""Log-odds for which it is printed what would be accepted."""


def run(options: BeliefOptions) -> None:
    """Sample buildings two by two, fit, print what would be accepted, write the network."""
    scenarios, seeds = options.checked_for_training()
    if len(seeds) < 2:
        raise InputError(f"--seeds {options.seeds!r}: expected two or more")
    require()
    trials = [
        Trial("belief", name, a, "joint", {"second": b, "length": list(length)})
        for length in LENGTHS
        for a, b in zip(seeds[::2], seeds[1::2], strict=False)
        for name in scenarios
    ]
    swept = options.sweep(trials, collect_from_two)
    known = Dataset.concat(Dataset.from_bytes(result.payload) for _, result in swept.answered)
    if not known.right.any() or known.right.all():
        raise InputError(f"--seeds {options.seeds}: expected right and wrong alignments, found one kind only")
    odds = cross_validate(known.features, known.right, known.building, np.random.default_rng(0))
    accepted_table(known, odds).print()
    fit_network(known.features, known.right, np.random.default_rng(0)).save(options.network)
    print(f"{options.network}: learnt from {len(known.right)} alignments, {known.right.sum()} of them right")
    finish(swept, options.store)


def collect_from_two(trial: Trial, nothing: None) -> Answer:
    """The samples of two buildings of one kind, and of maps of one with maps of the other."""
    seeds = (trial.seed, int(trial.config["second"]))
    shortest, longest = trial.config["length"]
    (first, first_moved), (second, second_moved) = (
        training_pairs(trial.scenario, seed, (shortest, longest)) for seed in seeds
    )
    known = [*first, *first_moved, *second, *second_moved]
    rng = np.random.default_rng([*seeds, 5])
    negative = negative_pairs(first, second) + negative_pairs(second, first)
    parts = [collect_samples(known + negative, False, rng), collect_samples(known, True, rng)]
    return Answer([], Dataset.concat(parts).to_bytes())


def accepted_table(known: Dataset, odds: np.ndarray) -> Table:
    """What is accepted at some of the log-odds ``(n,)``, with a prior and without: right by bin, false."""
    rows = []
    strange = known.bin == STRANGERS
    for guided, title in ((False, "without prior"), (True, "with prior")):
        mine = known.guided == guided
        for limit in LIMITS:
            taken = mine & known.allowed & (odds >= limit)
            right = [(taken & known.right)[mine & (known.bin == name)] for name in BINS]
            shares = [number(part.mean() if len(part) else None) for part in right]
            false = f"{np.sum(taken & ~known.right & ~strange)}/{np.sum(taken & ~strange)}"
            strangers = f"{np.sum(taken & strange)}/{np.sum(mine & strange)}"
            rows.append((title, f"{limit:.1f}", *shares, false, strangers))
    return Table(("", "least log-odds", *BINS, "false", STRANGERS), rows)
