"""How often two submaps of one building are joined rightly, wrongly or not at all, by true overlap."""

from __future__ import annotations

import csv
import os
import sys
import zlib
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, fields, replace
from functools import partial
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np
import tyro

from scenarios.ablate.table import lines_json, print_lines
from scenarios.catalogue import CATALOGUE
from scenarios.cli import BadInput, nearest

if TYPE_CHECKING:
    from scenarios.ablate.pairs import Pair
    from scenarios.ablate.trial import Row

PER_BUILDING, PER_TWIN_BUILDING = 5, 10
"""Most pairs of one bin from two visits to one building; of twins there is only one scenario."""
WITH_PRIOR = ("joint",)
"""Methods that are measured with a prior as well: of the others only the report's reads a part of it."""


@dataclass(frozen=True)
class Options:
    """Cut pairs of submaps from two simulated visits to a building, and let every method align them.

    Submaps are stretches of 20–40 m, drawn where the front end believed to be; before the second visit to
    every third building half the furniture is moved. Overlap is the share of the smaller map's known area
    that both visits have seen, from the true poses. A stitch is right within 0.3 m (at the middle of the
    overlap) and 2°. The prior has a standard deviation of 1 m on each axis and 10°, and errors as large.
    """

    pairs: int = 100
    """Pairs per bin; fewer where the seeds do not give as many."""
    methods: str = ""
    """Methods by name, with commas between; all without a name."""
    scenarios: str = "hospital,beehive,office_smoke,two_drives,twin_rooms"
    """Scenarios of the catalogue, with commas between; twin_rooms has a bin of its own."""
    seeds: str = "0-9"
    """Seeds: first-last, or numbers with commas between; more are used only while a bin is not full."""
    workers: int = 0
    """Processes; 0 takes a process for each core. The results do not depend on it."""
    format: Literal["table", "json"] = "table"
    """What is printed on stdout."""
    out: Annotated[Path | None, tyro.conf.arg(aliases=["-o"])] = None
    """A folder for results.csv, one row per answer; without it nothing is written."""


def run(options: Options) -> None:
    """Harvest buildings until the bins are full, and print what the methods made of the pairs."""
    methods, scenarios, seeds = (
        known_methods(options.methods),
        known_scenarios(options),
        seeds_of(options.seeds),
    )
    if options.pairs < 1 or options.workers < 0:
        raise BadInput(f"expected --pairs > 0 and --workers >= 0, got {options.pairs} and {options.workers}")
    if options.out is not None and options.out.is_file():
        raise BadInput(f"--out {options.out}: expected a folder, found a file")

    from scenarios.ablate.pairs import ALL_BINS
    from scenarios.ablate.summary import lines

    buildings = [(name, seed) for seed, name in product(seeds, scenarios)]
    reports = list(gather(buildings, methods, options))
    rows = [row for report in reports for pair_rows in report.rows for row in pair_rows]
    if not rows:
        raise BadInput(
            f"no pairs: none of {options.scenarios} with seeds {options.seeds} has stretches that overlap"
        )
    if options.out is not None:
        write(rows, options.out)
    found = lines(rows, ALL_BINS)
    if options.format == "json":
        about = {
            "study": "stitching",
            "seeds": options.seeds,
            "scenarios": scenarios,
            "buildings": len(reports),
        }
        print(lines_json(found, about))
        return
    cut, bent = sum(report.stretches for report in reports), sum(report.bent for report in reports)
    print_lines(
        f"stitching: {len(reports)} buildings, seeds {options.seeds}",
        found,
        [
            "right and refused: share of the bin's pairs [95 % interval]; ms: median processor time; "
            "ANEES/3: of the right ones, 1 is honest",
            f"{bent} of {cut} stretches were bent by more than 0.15 m or 1° and left out",
        ],
    )


@dataclass(frozen=True)
class Report:
    """The answers for one building, grouped by pair, and how many of its stretches were bent."""

    name: str
    seed: int
    rows: tuple[tuple[Row, ...], ...]
    stretches: int
    bent: int


def gather(
    buildings: Sequence[tuple[str, int]], methods: Sequence[str], options: Options
) -> Iterator[Report]:
    """Reports of the buildings that help to fill a bin, in their order; pairs beyond are left out.

    A building none of whose bins is open any more is not begun, or not counted if it was.
    """
    from scenarios.ablate.pairs import TWINS, bins_of
    from scenarios.ablate.workers import in_order

    counts: Counter[str] = Counter()

    def is_open(building: tuple[str, int]) -> bool:
        return any(counts[where] < options.pairs for where in bins_of(building[0]))

    work = partial(answers, methods=tuple(methods), most=options.pairs)
    workers = options.workers or os.cpu_count() or 1
    for report in in_order(work, filter(is_open, buildings), workers):
        kept = []
        for pair_rows in report.rows:
            where = pair_rows[0].bin
            if counts[where] < options.pairs:
                counts[where] += 1
                kept.append(pair_rows)
        if kept:
            said = ", ".join(
                f"{where} {counts[where]}" for where in sorted(counts, key=lambda w: (w == TWINS, w))
            )
            print(f"{report.name} {report.seed}: {said}", file=sys.stderr)
            yield replace(report, rows=tuple(kept))


def answers(building: tuple[str, int], methods: tuple[str, ...], most: int) -> Report:
    """All methods' rows for the pairs of a building, grouped by pair, at most ``most`` in a bin."""
    from scenarios.ablate.pairs import TWIN_SCENARIO, harvest

    name, seed = building
    quota = PER_TWIN_BUILDING if name == TWIN_SCENARIO else PER_BUILDING
    found = harvest(CATALOGUE[name], seed, min(quota, most))
    return Report(name, seed, rows_of(found.pairs, methods), found.stretches, found.bent)


def rows_of(pairs: Sequence[Pair], methods: Sequence[str]) -> tuple[tuple[Row, ...], ...]:
    """All methods' rows for each pair; the error of its prior is the pair's own."""
    from scenarios.ablate.trial import Variant, attempt
    from stitch.align import AlignConfig, align

    rows = []
    for k, pair in enumerate(pairs):
        answered = []
        for method in methods:
            config = AlignConfig(method=method)  # type: ignore[arg-type]
            if k == 0:
                align(pair.a, pair.b, None, config)  # load its kernels before its time is taken
            for prior in (False, True) if method in WITH_PRIOR else (False,):
                rng = np.random.default_rng([pair.seed, zlib.crc32(pair.scenario.encode()), 4, k])
                answered.append(attempt(pair, Variant(method, prior), config, rng))
        rows.append(tuple(answered))
    return tuple(rows)


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
            raise BadInput(f"unknown {what} {name!r}: {nearest(name, known)}")
    if not asked:
        raise BadInput(f"expected a {what}, one of {', '.join(known)}")
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
        raise BadInput(f"--seeds {text!r}: expected first-last or numbers with commas between, as 0-9 or 3,5")
    return seeds


def write(rows: Sequence[Row], folder: Path) -> None:
    """One row per answer, in results.csv."""
    from scenarios.ablate.trial import Row

    folder.mkdir(parents=True, exist_ok=True)
    with (folder / "results.csv").open("w", newline="") as file:
        table = csv.DictWriter(file, [field.name for field in fields(Row)])
        table.writeheader()
        table.writerows(asdict(row) for row in rows)
