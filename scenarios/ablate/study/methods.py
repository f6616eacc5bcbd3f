"""How good the map of a whole drive becomes, by scenario and method, on the same drives."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np
import tyro

from scenarios.options import StudyOptions, parse_names
from scenarios.sweep import finish, write_results
from slam.cli import InputError

if TYPE_CHECKING:
    from scenarios.ablate.method_variants import DriveResult, MethodVariant

BOOTSTRAP_SEED = 0


@dataclass(frozen=True)
class Options(StudyOptions):
    """Simulate every scenario with every seed, let every method map each drive, and compare them.

    A drive that makes a method fail is left out of its figures and counted; the exit code is then 1.
    """

    scenarios: str = "hospital,office_smoke,two_drives,collapsed,outdoor,twin_rooms"
    """Scenarios of the catalogue, with commas between."""
    seeds: str = "10"
    """Seeds: how many, counted from 0; or first-last; or numbers with commas between."""
    out: Annotated[Path, tyro.conf.arg(aliases=["-o"])] = Path("runs/ablate-methods")
    """A folder for results.csv and sweep.sqlite, from which a sweep that was interrupted goes on."""
    methods: str = "ins,wsm,slamstitch,oracle"
    """Methods by name, with commas between; "oracle" is ours, told the true cuts and loop closures."""
    variant: str = "gnc"
    """Back ends of slamstitch, with commas between: gnc, none (every stitch is kept)."""
    inject: float = 0.0
    """Run slamstitch again with so many false stitches that they are this share of all."""
    format: Literal["table", "json"] = "table"
    """What is printed on stdout."""


def run(options: Options) -> None:
    """Every method on every drive, and what came of it. Exits with 1 when a trial failed."""
    scenarios, seeds, variants = checked(options)

    from scenarios.ablate.method_variants import DriveResult, run_trial, simulate_recording
    from scenarios.ablate.paired_comparison import compare_methods, print_ranking, ranking_json, summarise

    trials = [variant.trial(*drive) for drive in product(scenarios, seeds) for variant in variants]
    swept = options.sweep(trials, run_trial, prepare=simulate_recording)
    results = [DriveResult.of(*both) for both in zip(swept.trials, swept.answers, strict=True)]
    write(results, options.out)
    summaries = summarise(results)
    ratios = compare_methods(results, variants, np.random.default_rng(BOOTSTRAP_SEED))
    if options.format == "json":
        about = {"study": "methods", "scenarios": scenarios, "seeds": seeds}
        print(ranking_json(summaries, ratios, [result for result in results if result.error], about))
    else:
        print_ranking(f"methods: seeds {options.seeds}", summaries, ratios)
    finish(swept, options.store)


def checked(options: Options) -> tuple[list[str], list[int], tuple[MethodVariant, ...]]:
    """Scenarios, seeds and variants of methods. Raises `InputError`."""
    from scenarios.ablate.method_variants import OURS, method_variants
    from scenarios.methods import METHODS
    from stitch.mapping.submap_graph import BACK_ENDS

    methods = parse_names(options.methods, METHODS, "method")
    back_ends = parse_names(options.variant, BACK_ENDS, "variant", "--variant")
    if not 0.0 <= options.inject < 1.0:
        raise InputError(f"--inject {options.inject:g}: expected a share of at least 0 and below 1")
    if OURS not in methods and (options.inject > 0.0 or options.variant != Options.variant):
        raise InputError(f"--variant and --inject are for {OURS}: expected it among --methods")
    return *options.checked(count=True), method_variants(methods, back_ends, options.inject)  # type: ignore[arg-type]


def write(results: Sequence[DriveResult], folder: Path) -> None:
    """One row per drive and method in results.csv: seconds, the error if any, and every metric."""
    from scenarios.ablate.method_variants import LAST
    from scenarios.evaluation import DEFINITIONS

    known = {name for result in results for name in result.values}
    columns = [name for name in [*DEFINITIONS, LAST] if name in known]
    header = ["scenario", "seed", "method", "seconds", "error", *columns]
    rows = ({name: getattr(result, name) for name in header[:5]} | result.values for result in results)
    write_results(folder / "results.csv", header, rows)
