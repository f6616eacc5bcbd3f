"""Which measure knows that the robot is lost, and what its cuts are worth to the map."""

from __future__ import annotations

import shlex
import sys
from statistics import fmean

from scenarios.ablate.options import SegmentationOptions
from scenarios.ablate.segmentation.findings import analyse, collect_drives
from scenarios.ablate.segmentation.page import draw_pictures, render
from scenarios.ablate.segmentation.table import (
    RESULT_COLUMNS,
    findings_json,
    findings_table,
    result_rows,
    verdict,
)
from scenarios.ablate.segmentation.trials import NEVER, TRUTH, label_drive, run_trial, trials
from scenarios.options import parse_names
from scenarios.sweep import SweepResult, finish, write_results
from slam.odometry.confidence import MEASURES
from slam.odometry.segmentation import THRESHOLDS


def run(options: SegmentationOptions) -> None:
    """Every measure on every drive, what it is worth, and the page. Exits with 1 when a trial failed."""
    measures = parse_names(options.measures or ",".join(MEASURES), MEASURES, "measure")
    scenarios, seeds = options.checked(count=True)
    cutters = [] if options.no_maps else [*(name for name in measures if name in THRESHOLDS), NEVER, TRUTH]
    swept = options.sweep(trials(scenarios, seeds, cutters, options.thorough), run_trial, prepare=label_drive)
    drives = collect_drives(swept.answered)
    if drives:
        findings = analyse(drives, measures)
        sentences, pictures = verdict(findings), draw_pictures(findings)
        write_results(options.out / "results.csv", RESULT_COLUMNS, result_rows(findings))
        for picture in pictures:
            (options.out / f"{picture.name}.png").write_bytes(picture.png)
        command = shlex.join(["python", "-m", "scenarios.ablate", "segmentation", *sys.argv[1:]])
        about = {"command": command, "cost": cost(swept), "thorough": options.thorough}
        page = render(findings, sentences, pictures, **about)
        (options.out / "index.html").write_text(page, encoding="utf-8")
        if options.format == "json":
            about = {"study": "segmentation", "scenarios": scenarios, "seeds": seeds}
            print(findings_json(findings, about, sentences))
        else:
            findings_table(f"segmentation: seeds {options.seeds}", findings, sentences).print()
            print(f"\n{options.out / 'index.html'}")
    finish(swept, options.store)


def cost(swept: SweepResult) -> str:
    """Mean wall time of the trials and of what is prepared once per drive, as a sentence."""
    seconds = [outcome.seconds for outcome in swept.outcomes if not outcome.failed]
    preparing = [o.preparing for o in swept.outcomes if not o.failed and o.preparing > 0.0] or [0.0]
    return (
        f"{len(seconds)} trials of {fmean(seconds):.1f} s on average, and {fmean(preparing):.1f} s once per "
        "drive for simulation and front end."
    )
