"""How often two submaps of one building are joined rightly, wrongly or not at all, by true overlap."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields, replace
from functools import partial
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from scenarios.ablate.table import lines_json, print_lines
from scenarios.catalogue import CATALOGUE
from scenarios.sweep import check, finish, sweep, write_results
from slam.cli import InputError, nearest

if TYPE_CHECKING:
    from scenarios.ablate.harvesting import Report

PER_BUILDING, PER_TWIN_BUILDING = 5, 10
"""Most pairs of one bin from two visits to one building; of twins there is only one scenario."""
WITH_PRIOR = ("joint",)
"""Methods that are measured with a prior as well: of the others only the report's reads a part of it."""

HELD = 1.0
"""Pairs that share less wall [m] across some direction can slide: what they share is a bare corridor."""


@dataclass(frozen=True)
class Options:
    """Cut pairs of submaps from two simulated visits to a building, and let every method align them.

    Submaps are stretches of a drive (``--length``), drawn where the front end believed to be; before the
    second visit to every third building half the furniture is moved. Overlap is the share of the smaller
    map's known area that both visits have seen, from the true poses. A stitch is right within 0.3 m (at the
    middle of the overlap) and 2°. The prior has a standard deviation of 1 m on each axis and 10°, and errors
    as large.
    """

    pairs: int = 100
    """Pairs per bin; fewer where the seeds do not give as many."""
    methods: str = ""
    """Methods by name, with commas between; all without a name."""
    scenarios: str = "hospital,beehive,office_smoke,two_drives,twin_rooms"
    """Scenarios of the catalogue, with commas between; twin_rooms has a bin of its own."""
    seeds: str = "0-19"
    """Seeds: first-last, or numbers with commas between; more are used only while a bin is not full."""
    length: Annotated[tuple[float, float], tyro.conf.arg(metavar="SHORTEST LONGEST")] = (30.0, 60.0)
    """Metres of drive that make a submap; those of 30–60 m are of about 30 × 20 m."""
    workers: int = 0
    """Processes; 0 takes a process for each core. The results do not depend on it."""
    scheduler: Annotated[str | None, tyro.conf.arg(metavar="tcp://HOST:PORT")] = None
    """A running Dask scheduler whose workers do the trials, instead of processes of this machine."""
    format: Literal["table", "json"] = "table"
    """What is printed on stdout."""
    out: Annotated[Path, tyro.conf.arg(aliases=["-o"])] = Path("runs/ablate-stitching")
    """A folder for results.csv and sweep.sqlite, from which a sweep that was interrupted goes on."""
    fresh: bool = False
    """Forget the trials that the folder holds and run them again."""


def run(options: Options) -> None:
    """Harvest buildings until the bins are full, and print what the methods made of the pairs."""
    methods, scenarios, seeds = (
        known_methods(options.methods),
        known_scenarios(options),
        seeds_of(options.seeds),
    )
    if options.pairs < 1:
        raise InputError(f"expected --pairs > 0, got {options.pairs}")
    if not 0.0 < options.length[0] <= options.length[1]:
        raise InputError(f"--length: expected metres, 0 < shortest <= longest, got {options.length}")
    check(options.scheduler, options.workers, options.out)

    from scenarios.ablate.harvesting import Bins, answer, harvested, kept, trials
    from scenarios.ablate.pairs import ALL_BINS, BINS
    from scenarios.ablate.summary import lines
    from scenarios.ablate.trial import Row

    bins = Bins(options.pairs)
    buildings = [(name, seed) for seed, name in product(seeds, scenarios)]
    swept = sweep(
        trials(buildings, methods, bins, options.length),
        answer,
        options.out / "sweep.sqlite",
        prepare=partial(harvested, most=options.pairs, length=options.length),
        each=bins.take,
        scheduler=options.scheduler,
        workers=options.workers,
        fresh=options.fresh,
    )
    reports = kept(swept, options.pairs)
    rows = [row for report in reports for row in report.rows]
    if not rows and not swept.failed:
        raise InputError(
            f"no pairs: none of {options.scenarios} with seeds {options.seeds} has stretches that overlap"
        )
    write_results(options.out / "results.csv", [field.name for field in fields(Row)], map(asdict, rows))
    found, held = lines(rows, ALL_BINS), lines([row for row in rows if row.hold >= HELD], BINS)
    if options.format == "json":
        about = {"study": "stitching", "seeds": options.seeds, "scenarios": scenarios}
        print(
            lines_json(
                [*found, *(replace(one, bin=f"{one.bin} held") for one in held)],
                about | {"buildings": len(reports)},
            )
        )
    else:
        print_lines(f"stitching: {len(reports)} buildings, seeds {options.seeds}", found, notes(reports))
        print_lines(
            f"of these, pairs whose shared walls hold them by {HELD:g} m in every direction", held, []
        )
    finish(swept, options.out / "sweep.sqlite")


def notes(reports: Sequence[Report]) -> list[str]:
    """What stands below the table."""
    import numpy as np

    if not reports:
        return ["no building gave an answer"]
    cut, bent = sum(report.stretches for report in reports), sum(report.bent for report in reports)
    long, short = np.median([side for report in reports for side in report.sizes], axis=0)
    return [
        "right and refused: share of the bin's pairs [95 % interval]; ms: median processor time; "
        "ANEES/3: of the right ones, 1 is honest",
        f"the maps' rectangles are {long:.0f} × {short:.0f} m in the median",
        f"{bent} of {cut} stretches were bent by more than 0.15 m or 1° and left out",
    ]


def known_methods(names: str) -> list[str]:
    """The methods asked for; all without a name."""
    from stitch.align import METHODS

    return chosen(names, list(METHODS), "method") if names else list(METHODS)


def known_scenarios(options: Options) -> list[str]:
    """The scenarios asked for."""
    return chosen(options.scenarios, list(CATALOGUE), "scenario")


def chosen(names: str, known: Sequence[str], what: str) -> list[str]:
    """Names with commas between, each of them known."""
    asked = [name.strip() for name in names.split(",") if name.strip()]
    for name in asked:
        if name not in known:
            raise InputError(f"unknown {what} {name!r}: {nearest(name, known)}")
    if not asked:
        raise InputError(f"expected a {what}, one of {', '.join(known)}")
    return list(dict.fromkeys(asked))


def seeds_of(text: str) -> list[int]:
    """Seeds of ``first-last`` or of numbers with commas between."""
    try:
        if "-" in text:
            first, last = (int(word) for word in text.split("-"))
            seeds = list(range(first, last + 1))
        else:
            seeds = [int(word) for word in text.split(",")]
    except ValueError:
        seeds = []
    if not seeds or min(seeds) < 0:
        raise InputError(
            f"--seeds {text!r}: expected first-last or numbers with commas between, as 0-9 or 3,5"
        )
    return seeds
