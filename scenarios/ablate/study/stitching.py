"""How often two submaps of one building are joined rightly, wrongly or not at all, by true overlap."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields, replace
from functools import partial
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from scenarios.options import StudyOptions, parse_names
from scenarios.sweep import finish, write_results
from slam.cli import InputError

if TYPE_CHECKING:
    from scenarios.ablate.stitching_trials import BuildingResult

HELD = 1.0
"""Pairs that share less wall [m] across some direction can slide: what they share is a bare corridor."""


@dataclass(frozen=True)
class Options(StudyOptions):
    """Cut pairs of submaps from two simulated drives through a building, and let every method align them.

    Submaps are fragments of a drive (``--length``), drawn at the poses that the front end estimated; before
    the second drive through every third building half the furniture is moved. Overlap is the share of the
    smaller map's known area that both drives have seen, from the true poses. An alignment is right within
    0.3 m (at the middle of the overlap) and 2°. The prior has a standard deviation of 1 m on each axis and
    10°, and errors as large.
    """

    scenarios: str = "hospital,beehive,office_smoke,two_drives,twin_rooms"
    """Scenarios of the catalogue, with commas between; twin_rooms has a bin of its own."""
    seeds: str = "0-19"
    """Seeds: first-last, or numbers with commas between; more are used only while a bin is not full."""
    out: Annotated[Path, tyro.conf.arg(aliases=["-o"])] = Path("runs/ablate-stitching")
    """A folder for results.csv and sweep.sqlite, from which a sweep that was interrupted goes on."""
    pairs: int = 100
    """Pairs per bin; fewer where the seeds do not give as many."""
    methods: str = ""
    """Methods by name, with commas between; all without a name."""
    length: Annotated[tuple[float, float], tyro.conf.arg(metavar="SHORTEST LONGEST")] = (30.0, 60.0)
    """Metres of drive that make a submap; those of 30–60 m are of about 30 × 20 m."""
    format: Literal["table", "json"] = "table"
    """What is printed on stdout."""


def run(options: Options) -> None:
    """Sample buildings until the bins are full, and print what the methods made of the pairs."""
    from stitch.align import METHODS

    methods = parse_names(options.methods or ",".join(METHODS), METHODS, "method")
    scenarios, seeds = options.checked()
    if options.pairs < 1:
        raise InputError(f"expected --pairs > 0, got {options.pairs}")
    if not 0.0 < options.length[0] <= options.length[1]:
        raise InputError(f"--length: expected metres, 0 < shortest <= longest, got {options.length}")

    from scenarios.ablate.pair_sampling import ALL_BINS, BINS, pairs_of_building
    from scenarios.ablate.stitching_summary import summaries_json, summarise, summary_table
    from scenarios.ablate.stitching_trials import (
        AlignmentRow,
        BinCounts,
        run_trial,
        trials,
        truncate_to_quota,
    )

    bins = BinCounts(options.pairs)
    buildings = [(name, seed) for seed, name in product(seeds, scenarios)]
    swept = options.sweep(
        trials(buildings, methods, bins, options.length),
        run_trial,
        prepare=partial(pairs_of_building, most=options.pairs, length=options.length),
        each=bins.take,
    )
    results = truncate_to_quota(swept, options.pairs)
    rows = [row for result in results for row in result.rows]
    if not rows and not swept.failed:
        raise InputError(
            f"no pairs: none of {options.scenarios} with seeds {options.seeds} has stretches that overlap"
        )
    write_results(options.out / "results.csv", [f.name for f in fields(AlignmentRow)], map(asdict, rows))
    everything = summarise(rows, ALL_BINS)
    held = summarise([row for row in rows if row.hold >= HELD], BINS)
    if options.format == "json":
        about = {"study": "stitching", "seeds": options.seeds, "scenarios": scenarios}
        both = [*everything, *(replace(one, bin=f"{one.bin} held") for one in held)]
        print(summaries_json(both, about | {"buildings": len(results)}))
    else:
        title = f"stitching: {len(results)} buildings, seeds {options.seeds}"
        summary_table(title, everything, notes(results)).print()
        title = f"of these, pairs whose shared walls hold them by {HELD:g} m in every direction"
        summary_table(title, held, ()).print()
    finish(swept, options.store)


def notes(results: Sequence[BuildingResult]) -> list[str]:
    """What stands below the table."""
    import numpy as np

    if not results:
        return ["no building gave an answer"]
    cut, bent = sum(result.stretches for result in results), sum(result.bent for result in results)
    long, short = np.median([side for result in results for side in result.sizes], axis=0)
    return [
        "right and refused: share of the bin's pairs [95 % interval]; ms: median processor time; "
        "ANEES/3: of the right ones, 1 is honest",
        f"the maps' rectangles are {long:.0f} × {short:.0f} m in the median",
        f"{bent} of {cut} stretches were bent by more than 0.15 m or 1° and left out",
    ]
