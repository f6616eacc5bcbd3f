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

from scenarios.options import StudyOptions, parse_names
from scenarios.sweep import finish

if TYPE_CHECKING:
    from scenarios.ablate.segmentation.findings import Findings
    from scenarios.sweep import SweepResult


@dataclass(frozen=True)
class Options(StudyOptions):
    """Let ManifoldSLAM track every drive, and score every measure of confidence against the truth.

    Then let each cut every drive, at a threshold learnt on other scenarios, and map what is left. Writes
    results.csv, the figures and index.html.
    """

    scenarios: str = "hospital,office_smoke,collapsed,outdoor"
    """Scenarios of the catalogue, with commas between; those that thresholds were learnt on are beehive,
    corridor, twin_rooms and two_drives."""
    seeds: str = "20"
    """Seeds: how many, counted from 0; or first-last; or numbers with commas between."""
    out: Annotated[Path, tyro.conf.arg(aliases=["-o"])] = Path("runs/ablate-segmentation")
    """A folder for results.csv, the page and sweep.sqlite, from which an interrupted sweep goes on."""
    measures: str = ""
    """Measures by name, with commas between; all without a name."""
    no_maps: bool = False
    """Score the measures only; let nothing be cut."""
    thorough: bool = False
    """Map with slamstitch's own settings, which takes about twice as long."""
    format: Literal["table", "json"] = "table"
    """What is printed on stdout."""


def run(options: Options) -> None:
    """Every measure on every drive, what it is worth, and the page. Exits with 1 when a trial failed."""
    from slam.odometry.confidence import MEASURES

    measures = parse_names(options.measures or ",".join(MEASURES), MEASURES, "measure")
    scenarios, seeds = options.checked(count=True)

    from scenarios.ablate.segmentation.drive import label_drive
    from scenarios.ablate.segmentation.findings import analyse
    from scenarios.ablate.segmentation.scores import collect_drives
    from scenarios.ablate.segmentation.table import findings_json, findings_table
    from scenarios.ablate.segmentation.trials import NEVER, TRUTH, run_trial, trials
    from scenarios.ablate.segmentation.verdict import verdict
    from slam.odometry.segmentation import THRESHOLDS

    cutters = [] if options.no_maps else [*(name for name in measures if name in THRESHOLDS), NEVER, TRUTH]
    swept = options.sweep(trials(scenarios, seeds, cutters, options.thorough), run_trial, prepare=label_drive)
    drives = collect_drives(swept.answered)
    if drives:
        findings = analyse(drives, measures)
        sentences = verdict(findings)
        write(options, findings, sentences, swept)
        if options.format == "json":
            about = {"study": "segmentation", "scenarios": scenarios, "seeds": seeds}
            print(findings_json(findings, about, sentences))
        else:
            findings_table(f"segmentation: seeds {options.seeds}", findings, sentences).print()
            print(f"\n{options.out / 'index.html'}")
    finish(swept, options.store)


def write(options: Options, findings: Findings, sentences: Sequence[str], swept: SweepResult) -> None:
    """results.csv, the figures and the page."""
    from scenarios.ablate.segmentation.page import draw_pictures, render
    from scenarios.ablate.segmentation.table import results_csv

    options.out.mkdir(parents=True, exist_ok=True)
    (options.out / "results.csv").write_text(results_csv(findings), encoding="utf-8")
    pictures = draw_pictures(findings)
    for picture in pictures:
        (options.out / f"{picture.name}.png").write_bytes(base64.b64decode(picture.data))
    command = shlex.join(["python", "-m", "scenarios.ablate", "segmentation", *sys.argv[1:]])
    page = render(findings, sentences, pictures, command, cost(swept), options.thorough)
    (options.out / "index.html").write_text(page, encoding="utf-8")


def cost(swept: SweepResult) -> str:
    """Mean wall time of the trials and of what is prepared once per drive, as a sentence."""
    outcomes = [outcome for outcome in swept.outcomes if not outcome.failed]
    preparing = [outcome.preparing for outcome in outcomes if outcome.preparing > 0.0]
    seconds = sum(outcome.seconds for outcome in outcomes)
    return (
        f"{len(outcomes)} trials of {seconds / max(len(outcomes), 1):.1f} s on average, and "
        f"{sum(preparing) / max(len(preparing), 1):.1f} s once per drive for simulation and front end."
    )
