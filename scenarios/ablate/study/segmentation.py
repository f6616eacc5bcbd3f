"""Which measure knows that the robot is lost, and what its cuts are worth to the map."""

from __future__ import annotations

import base64
import shlex
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from scenarios.ablate.study.methods import counted
from scenarios.ablate.study.stitching import chosen
from scenarios.catalogue import CATALOGUE
from scenarios.sweep import check, finish, sweep
from slam.cli import InputError

if TYPE_CHECKING:
    from scenarios.ablate.segmentation.findings import Findings
    from scenarios.sweep import SweepResult


@dataclass(frozen=True)
class Options:
    """Let ManifoldSLAM track every drive, and score every measure of confidence against the truth.

    Then let each cut every drive, at a threshold learnt on other scenarios, and map what is left. Writes
    results.csv, the figures and index.html.
    """

    scenarios: str = "hospital,office_smoke,collapsed,outdoor"
    """Scenarios of the catalogue, with commas between; those that thresholds were learnt on are beehive,
    corridor, twin_rooms and two_drives."""
    seeds: str = "20"
    """Seeds: how many, counted from 0; or first-last; or numbers with commas between."""
    measures: str = ""
    """Measures by name, with commas between; all without a name."""
    no_maps: bool = False
    """Score the measures only; let nothing be cut."""
    thorough: bool = False
    """Map with slamstitch's own settings, which takes about twice as long."""
    workers: int = 0
    """Processes; 0 takes a process for each core. The results do not depend on it."""
    scheduler: Annotated[str | None, tyro.conf.arg(metavar="tcp://HOST:PORT")] = None
    """A running Dask scheduler whose workers do the trials, instead of processes of this machine."""
    format: Literal["table", "json"] = "table"
    """What is printed on stdout."""
    out: Annotated[Path, tyro.conf.arg(aliases=["-o"])] = Path("runs/ablate-segmentation")
    """A folder for results.csv, the page and sweep.sqlite, from which an interrupted sweep goes on."""
    fresh: bool = False
    """Forget the trials that the folder holds and run them again."""


def run(options: Options) -> None:
    """Every measure on every drive, what it is worth, and the page. Exits with 1 when a trial failed."""
    scenarios, seeds, measures = checked(options)

    from scenarios.ablate.segmentation.cutting import NEVER, TRUTH
    from scenarios.ablate.segmentation.drive import driven
    from scenarios.ablate.segmentation.findings import findings
    from scenarios.ablate.segmentation.scores import drives
    from scenarios.ablate.segmentation.table import findings_json, print_findings
    from scenarios.ablate.segmentation.trials import answer, trials
    from scenarios.ablate.segmentation.verdict import verdict
    from slam.odometry.segmentation import THRESHOLDS

    cutters = [] if options.no_maps else [*(name for name in measures if name in THRESHOLDS), NEVER, TRUTH]
    swept = sweep(
        trials(scenarios, seeds, cutters, options.thorough), answer, options.out / "sweep.sqlite",
        prepare=driven, scheduler=options.scheduler, workers=options.workers, fresh=options.fresh,
    )  # fmt: skip
    answered = drives(swept.answered)
    if answered:
        found = findings(answered, measures)
        said = verdict(found)
        write(options, found, said, swept)
        about = {"study": "segmentation", "scenarios": scenarios, "seeds": seeds}
        if options.format == "json":
            print(findings_json(found, about, said))
        else:
            print_findings(f"segmentation: seeds {options.seeds}", found, said)
            print(f"\n{options.out / 'index.html'}")
    finish(swept, options.out / "sweep.sqlite")


def checked(options: Options) -> tuple[list[str], list[int], list[str]]:
    """Scenarios, seeds and measures asked for. Raises `InputError`."""
    from slam.odometry.confidence import MEASURES

    scenarios = chosen(options.scenarios, list(CATALOGUE), "scenario")
    seeds = counted(options.seeds)
    measures = chosen(options.measures, list(MEASURES), "measure") if options.measures else list(MEASURES)
    check(options.scheduler, options.workers, options.out)
    if options.out.is_file():
        raise InputError(f"--out {options.out}: expected a folder, found a file")
    return scenarios, seeds, measures


def write(options: Options, found: Findings, verdict: Sequence[str], swept: SweepResult) -> None:
    """results.csv, the figures and the page."""
    from scenarios.ablate.segmentation.page import pictures, render
    from scenarios.ablate.segmentation.table import results_csv

    options.out.mkdir(parents=True, exist_ok=True)
    (options.out / "results.csv").write_text(results_csv(found), encoding="utf-8")
    shown = pictures(found)
    for picture in shown:
        (options.out / f"{picture.name}.png").write_bytes(base64.b64decode(picture.data))
    command = shlex.join(["python", "-m", "scenarios.ablate", "segmentation", *sys.argv[1:]])
    page = render(found, verdict, shown, command, cost(swept), options.thorough)
    (options.out / "index.html").write_text(page, encoding="utf-8")


def cost(swept: SweepResult) -> str:
    """What the trials took, each on average, as the clock has it."""
    outcomes = [outcome for outcome in swept.outcomes if not outcome.failed]
    preparing = [outcome.preparing for outcome in outcomes if outcome.preparing > 0.0]
    seconds = sum(outcome.seconds for outcome in outcomes)
    return (
        f"{len(outcomes)} trials of {seconds / max(len(outcomes), 1):.1f} s on average, and "
        f"{sum(preparing) / max(len(preparing), 1):.1f} s once per drive for simulation and front end."
    )
