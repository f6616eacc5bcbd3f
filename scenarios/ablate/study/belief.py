"""How far an alignment may be believed, learnt from pairs whose truth is known."""

from __future__ import annotations

import io
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np
import tyro

from scenarios.ablate.study.likeness import REPORTED
from scenarios.ablate.study.stitching import chosen, seeds_of
from scenarios.catalogue import CATALOGUE
from slam.cli import InputError

if TYPE_CHECKING:
    from scenarios.ablate.lessons import Lessons
    from scenarios.sweep import Answer, Trial


LENGTHS = ((20.0, 40.0), (30.0, 60.0))
"""Of the shortest and the longest stretch [m] that is a submap: smaller and larger ones are learnt from."""


@dataclass(frozen=True)
class Options:
    """Learn the network of `stitch.alignment.acceptance` from simulated pairs of submaps.

    The likeliest alignment of every pair, with a prior and without one, is an example, right or wrong within
    the limits of the stitching study; pairs of two buildings are examples that are always wrong. Furniture is
    moved in every building, in two of three besides the pairs in which it is not. What the network would
    accept is printed by bin, from networks that learnt from other seeds only.
    """

    scenarios: str = "hospital,beehive,office_smoke,two_drives,twin_rooms"
    """Scenarios of the catalogue, with commas between."""
    seeds: str = "200-263"
    """Seeds: first-last, or numbers with commas between; 100 and above, two or more."""
    network: Path = Path("belief.npz")
    """The file to write; the package reads the one in its folder stitch."""
    workers: int = 0
    """Processes; 0 takes a process for each core. The results do not depend on it."""
    scheduler: Annotated[str | None, tyro.conf.arg(metavar="tcp://HOST:PORT")] = None
    """A running Dask scheduler whose workers do the trials, instead of processes of this machine."""
    out: Annotated[Path, tyro.conf.arg(aliases=["-o"])] = Path("runs/ablate-belief")
    """A folder for sweep.sqlite, from which a sweep that was interrupted goes on."""
    fresh: bool = False
    """Forget the trials that the folder holds and run them again."""


def run(options: Options) -> None:
    """Harvest buildings two by two, fit, print what would be accepted, write the network."""
    from scenarios.sweep import Trial, check, finish, sweep

    seeds = seeds_of(options.seeds)
    if min(seeds) in REPORTED:
        raise InputError(f"--seeds {options.seeds!r}: expected seeds from 100 on, the others are reported on")
    if len(seeds) < 2:
        raise InputError(f"--seeds {options.seeds!r}: expected two or more")
    scenarios = chosen(options.scenarios, list(CATALOGUE), "scenario")
    check(options.scheduler, options.workers, options.out)

    from scenarios.ablate.lessons import Lessons, crossed, fit

    couples = [(name, a, b) for a, b in zip(seeds[::2], seeds[1::2], strict=False) for name in scenarios]
    trials = [
        Trial("belief", name, a, "joint", {"second": b, "length": list(length)})
        for length in LENGTHS
        for name, a, b in couples
    ]
    store = options.out / "sweep.sqlite"
    swept = sweep(
        trials, couple, store, scheduler=options.scheduler, workers=options.workers, fresh=options.fresh
    )
    learnt = Lessons.together([unpacked(answer.payload) for _, answer in swept.answered])
    if not learnt.right.any() or learnt.right.all():
        raise InputError(f"--seeds {options.seeds}: expected right and wrong alignments, found one kind only")
    print("\n".join(accepted_lines(learnt, crossed(learnt, np.random.default_rng(0)))))
    fit(learnt, np.random.default_rng(0)).save(options.network)
    print(
        f"{options.network}: learnt from {len(learnt.right)} alignments, {learnt.right.sum()} of them right"
    )
    finish(swept, store)


def couple(trial: Trial, material: None) -> Answer:
    """The lessons of two buildings of one kind, and of maps of one with maps of the other."""
    from scenarios.ablate.harvesting import both_ways
    from scenarios.ablate.lessons import Lessons, lessons, strangers
    from scenarios.sweep import Answer

    seeds = (trial.seed, int(trial.config["second"]))
    shortest, longest = trial.config["length"]
    (first, first_moved), (second, second_moved) = (
        both_ways(trial.scenario, seed, (shortest, longest)) for seed in seeds
    )
    known = [*first, *first_moved, *second, *second_moved]
    rng = np.random.default_rng([*seeds, 5])
    unknown = strangers(first, second) + strangers(second, first)
    found = [lessons(known + unknown, False, rng), lessons(known, True, rng)]
    return Answer([], packed(Lessons.together(found)))


def packed(lessons: Lessons) -> bytes:
    """Lessons as bytes."""
    buffer = io.BytesIO()
    np.savez_compressed(buffer, **vars(lessons))
    return buffer.getvalue()


def unpacked(payload: bytes) -> Lessons:
    """Lessons from `packed`."""
    from scenarios.ablate.lessons import Lessons

    with np.load(io.BytesIO(payload)) as stored:
        return Lessons(**stored)


def accepted_lines(lessons: Lessons, odds: np.ndarray) -> list[str]:
    """What is accepted at some log-odds: right by bin and the false, without a prior and with one."""
    from scenarios.ablate.lessons import STRANGERS
    from scenarios.ablate.pairs import BINS

    table = [f"{'least log-odds':>20}{''.join(f'{name:>8}' for name in BINS)}   false  {STRANGERS}"]
    for guided, title in ((False, "without prior"), (True, "with prior")):
        mine = lessons.guided == guided
        for limit in (-1.0, -0.5, 0.0, 0.3, 0.6, 1.0, 1.5, 2.0):
            taken = mine & lessons.allowed & (odds >= limit)
            shares = [_share(taken & lessons.right, mine & (lessons.bin == name)) for name in BINS]
            strange = lessons.bin == STRANGERS
            false = int(np.sum(taken & ~lessons.right & ~strange))
            table.append(
                f"{title:>14}{limit:6.1f}{''.join(f'{share:8.3f}' for share in shares)}"
                f"{false:4d}/{np.sum(taken & ~strange)}  {np.sum(taken & strange)}/{np.sum(mine & strange)}"
            )
    return table


def _share(some: np.ndarray, among: np.ndarray) -> float:
    """How many of the true are true in both; NaN where there are none."""
    return float(some[among].mean()) if among.any() else float("nan")
