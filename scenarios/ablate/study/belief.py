"""How far an alignment may be believed, learnt from pairs whose truth is known."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np
import tyro

from scenarios.options import StudyOptions
from scenarios.sweep import Answer, Trial, finish
from slam.cli import InputError

if TYPE_CHECKING:
    from scenarios.ablate.training_set import Dataset

LENGTHS = ((20.0, 40.0), (30.0, 60.0))
"""Distances driven for the shortest and the longest submap [m]: smaller and larger ones are learnt from."""
LIMITS = (-1.0, -0.5, 0.0, 0.3, 0.6, 1.0, 1.5, 2.0)
"""Log-odds for which it is printed what would be accepted."""


@dataclass(frozen=True)
class Options(StudyOptions):
    """Learn the network of `stitch.alignment.acceptance` from simulated pairs of submaps.

    The likeliest alignment of every pair, with a prior and without one, is an example, right or wrong within
    the limits of the stitching study; pairs of two buildings are examples that are always wrong. Furniture is
    moved in every building, in two of three besides the pairs in which it is not. What the network would
    accept is printed by bin, from networks that learnt from other seeds only. Needs the extra [train].
    """

    scenarios: str = "hospital,beehive,office_smoke,two_drives,twin_rooms"
    """Scenarios of the catalogue, with commas between."""
    seeds: str = "200-263"
    """Seeds: first-last, or numbers with commas between; 100 and above, two or more."""
    out: Annotated[Path, tyro.conf.arg(aliases=["-o"])] = Path("runs/ablate-belief")
    """A folder for sweep.sqlite, from which a sweep that was interrupted goes on."""
    network: Path = Path("belief.npz")
    """The file to write; the package reads the one in its folder stitch."""


def run(options: Options) -> None:
    """Sample buildings two by two, fit, print what would be accepted, write the network."""
    scenarios, seeds = options.checked_for_training()
    if len(seeds) < 2:
        raise InputError(f"--seeds {options.seeds!r}: expected two or more")

    from scenarios.ablate.classifiers import cross_validate, fit_network, require
    from scenarios.ablate.training_set import Dataset

    require()
    couples = [(name, a, b) for a, b in zip(seeds[::2], seeds[1::2], strict=False) for name in scenarios]
    trials = [
        Trial("belief", name, a, "joint", {"second": b, "length": list(length)})
        for length in LENGTHS
        for name, a, b in couples
    ]
    swept = options.sweep(trials, collect_from_two)
    known = Dataset.concat(part for _, result in swept.answered for part in Dataset.unpack(result.payload))
    if not known.right.any() or known.right.all():
        raise InputError(f"--seeds {options.seeds}: expected right and wrong alignments, found one kind only")
    odds = cross_validate(known.features, known.right, known.building, np.random.default_rng(0))
    print("\n".join(accepted_lines(known, odds)))
    fit_network(known.features, known.right, np.random.default_rng(0)).save(options.network)
    print(f"{options.network}: learnt from {len(known.right)} alignments, {known.right.sum()} of them right")
    finish(swept, options.store)


def collect_from_two(trial: Trial, nothing: None) -> Answer:
    """The samples of two buildings of one kind, and of maps of one with maps of the other."""
    from scenarios.ablate.pair_sampling import negative_pairs, training_pairs
    from scenarios.ablate.training_set import Dataset, collect_samples

    seeds = (trial.seed, int(trial.config["second"]))
    shortest, longest = trial.config["length"]
    (first, first_moved), (second, second_moved) = (
        training_pairs(trial.scenario, seed, (shortest, longest)) for seed in seeds
    )
    known = [*first, *first_moved, *second, *second_moved]
    rng = np.random.default_rng([*seeds, 5])
    negative = negative_pairs(first, second) + negative_pairs(second, first)
    parts = [collect_samples(known + negative, False, rng), collect_samples(known, True, rng)]
    return Answer([], Dataset.pack([Dataset.concat(parts)]))


def accepted_lines(known: Dataset, odds: np.ndarray) -> list[str]:
    """What is accepted at some log-odds: right by bin and the false, without a prior and with one."""
    from scenarios.ablate.pair_sampling import BINS, STRANGERS

    lines = [f"{'least log-odds':>20}{''.join(f'{name:>8}' for name in BINS)}   false  {STRANGERS}"]
    strange = known.bin == STRANGERS
    for guided, title in ((False, "without prior"), (True, "with prior")):
        mine = known.guided == guided
        for limit in LIMITS:
            taken = mine & known.allowed & (odds >= limit)
            shares = [_share(taken & known.right, mine & (known.bin == name)) for name in BINS]
            false = int(np.sum(taken & ~known.right & ~strange))
            lines.append(
                f"{title:>14}{limit:6.1f}{''.join(f'{share:8.3f}' for share in shares)}"
                f"{false:4d}/{np.sum(taken & ~strange)}  {np.sum(taken & strange)}/{np.sum(mine & strange)}"
            )
    return lines


def _share(part: np.ndarray, whole: np.ndarray) -> float:
    """Share of ``whole (n,)`` bool that is in ``part (n,)`` as well; NaN where it is empty."""
    return float(part[whole].mean()) if whole.any() else float("nan")
