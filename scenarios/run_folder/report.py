"""report.html: the run to look at."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from scenarios.report.album import Plate
from scenarios.report.page import render
from scenarios.run_folder.contents import Run

if TYPE_CHECKING:
    from scenarios.stages import Cost


def page(run: Run, plates: Sequence[Plate], stages: Mapping[str, Cost]) -> str:
    """The page of a run with its figures, what it was made with and what the stages so far cost."""
    made: Any = run.environment
    told = {
        "command": run.asked["command"],
        **({} if run.simulated is None else {"seed": run.seed}),  # a log is what it is
        "code": made["git"] or made["slamstitch"],
        "python": made["python"],
        "packages": made["packages"],
        "processor": f"{made['processor']}, {made['cores']} cores",
    }
    return render(run.recording, run.estimates, run.metrics, told, plates, run.simulated, stages)
