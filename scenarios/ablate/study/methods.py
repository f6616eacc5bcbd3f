"""How good the map of a whole drive becomes, by scenario and method, on the same drives."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np
import tyro

from scenarios.ablate.study.stitching import chosen, seeds_of
from scenarios.catalogue import CATALOGUE
from scenarios.sweep import check, finish, sweep, write_results
from slam.cli import InputError

if TYPE_CHECKING:
    from scenarios.ablate.contestants import Contestant
    from scenarios.ablate.drives import Drive

BOOTSTRAP_SEED = 0


@dataclass(frozen=True)
class Options:
    """Simulate every scenario with every seed, let every method map each drive, and compare them.

    A drive that makes a method fail is left out of its figures and counted; the exit code is then 1.
    """

    scenarios: str = "hospital,office_smoke,two_drives,collapsed,outdoor,twin_rooms"
    """Scenarios of the catalogue, with commas between."""
    seeds: str = "10"
    """Seeds: how many, counted from 0; or first-last; or numbers with commas between."""
    methods: str = "ins,wsm,slamstitch,oracle"
    """Methods by name, with commas between; "oracle" is ours, told the true cuts and loop closures."""
    variant: str = "gnc"
    """Back ends of slamstitch, with commas between: gnc, none (every stitch is kept)."""
    inject: float = 0.0
    """Run slamstitch again with so many false stitches that they are this share of all."""
    workers: int = 0
    """Processes; 0 takes a process for each core. The results do not depend on it."""
    scheduler: Annotated[str | None, tyro.conf.arg(metavar="tcp://HOST:PORT")] = None
    """A running Dask scheduler whose workers do the trials, instead of processes of this machine."""
    format: Literal["table", "json"] = "table"
    """What is printed on stdout."""
    out: Annotated[Path, tyro.conf.arg(aliases=["-o"])] = Path("runs/ablate-methods")
    """A folder for results.csv and sweep.sqlite, from which a sweep that was interrupted goes on."""
    fresh: bool = False
    """Forget the trials that the folder holds and run them again."""


def run(options: Options) -> None:
    """Every method on every drive, and what came of it. Exits with 1 when a trial failed."""
    scenarios, seeds, taking_part = checked(options)

    from scenarios.ablate.drives import answer, drive_of, recorded, trial_of
    from scenarios.ablate.standing import comparisons, standings
    from scenarios.ablate.standing_table import print_standings, standings_json

    store = options.out / "sweep.sqlite"
    swept = sweep(
        [trial_of(*drive, one) for drive in product(scenarios, seeds) for one in taking_part],
        answer,
        store,
        prepare=recorded,
        scheduler=options.scheduler,
        workers=options.workers,
        fresh=options.fresh,
    )
    rows = [drive_of(trial, found) for trial, found in zip(swept.trials, swept.answers, strict=True)]
    write(rows, options.out)
    failed = [row for row in rows if row.error]
    stands = standings(rows)
    pairs = comparisons(rows, taking_part, np.random.default_rng(BOOTSTRAP_SEED))
    if options.format == "json":
        about = {"study": "methods", "scenarios": scenarios, "seeds": seeds}
        print(standings_json(stands, pairs, failed, about))
    else:
        print_standings(f"methods: seeds {options.seeds}", stands, pairs)
    finish(swept, store)


def checked(options: Options) -> tuple[list[str], list[int], tuple[Contestant, ...]]:
    """Scenarios, seeds and contestants asked for. Raises `InputError`."""
    from scenarios.ablate.contestants import OURS, contestants
    from scenarios.methods import METHODS
    from stitch.mapping.loop_closure import BACK_ENDS

    scenarios, seeds = chosen(options.scenarios, list(CATALOGUE), "scenario"), counted(options.seeds)
    methods = chosen(options.methods, list(METHODS), "method")
    back_ends = chosen(options.variant, list(BACK_ENDS), "variant")
    if not 0.0 <= options.inject < 1.0:
        raise InputError(f"--inject {options.inject:g}: expected a share of at least 0 and below 1")
    if OURS not in methods and (options.inject > 0.0 or options.variant != Options.variant):
        raise InputError(f"--variant and --inject are for {OURS}: expected it among --methods")
    check(options.scheduler, options.workers, options.out)
    return scenarios, seeds, contestants(methods, back_ends, options.inject)  # type: ignore[arg-type]


def counted(text: str) -> list[int]:
    """Seeds of a plain count, of ``first-last``, or of numbers with commas between."""
    if not text.strip().isdecimal():
        return seeds_of(text)
    if int(text) < 1:
        raise InputError(f"--seeds {text!r}: expected at least one")
    return list(range(int(text)))


def write(rows: Sequence[Drive], folder: Path) -> None:
    """One row per drive and method in results.csv: seconds, the error if any, and every metric."""
    from scenarios.ablate.drives import LAST
    from scenarios.evaluation import DEFINITIONS

    known = {name for row in rows for name in row.values}
    columns = [name for name in [*DEFINITIONS, LAST] if name in known]
    header = ["scenario", "seed", "method", "seconds", "error", *columns]
    table = ({name: getattr(row, name) for name in header[:5]} | row.values for row in rows)
    write_results(folder / "results.csv", header, table)
