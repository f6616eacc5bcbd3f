"""report.html: the run to look at."""

from __future__ import annotations

from typing import Any

from scenarios.report.page import render
from scenarios.run_folder.contents import Run


def page(run: Run) -> str:
    """The page of a run, with what it was made with."""
    made: Any = run.environment
    told = {
        "command": run.asked["command"],
        "seed": run.seed,
        "code": made["git"] or made["slamstitch"],
        "python": made["python"],
        "packages": made["packages"],
        "processor": f"{made['processor']}, {made['cores']} cores",
    }
    return render(run.recording, run.estimates, run.metrics, told, run.simulated)
