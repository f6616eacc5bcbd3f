"""A run as one HTML file that opens without a network."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from markupsafe import Markup

from scenarios.corruptions import told
from scenarios.evaluation.metric import Metric
from scenarios.methods import BASELINE, OURS
from scenarios.report.figures import FigureSpec, run_specs, write_figures
from scenarios.report.html import script, style, template
from scenarios.report.live import data_address, live_content, script_safe
from scenarios.report.summary import headline, scores, tabulate, verdict
from scenarios.run_folder.write import Run
from scenarios.stages import Cost
from sim.record import SimulatedRun
from slam.recording import Recording
from stitch.mapping.estimate import Estimate


def write_report(folder: Path, run: Run, stages: Mapping[str, Cost]) -> None:
    """Write the ``figures`` of a run and its report.html into ``folder``, with what the ``stages`` so far
    cost."""
    figures = run_specs(run.recording, run.estimates, run.metrics, run.simulated)
    write_figures(folder / "figures", figures)
    page = render(run.recording, run.estimates, run.metrics, facts(run), figures, run.simulated, stages)
    (folder / "report.html").write_text(page, encoding="utf-8")


def facts(run: Run) -> dict[str, object]:
    """How a run was made: the command, and with what."""
    made: Any = run.environment
    return {
        "command": run.asked["command"],
        **({} if run.simulated is None else {"seed": run.seed}),  # a log has none
        "code": made["git"] or made["slamstitch"],
        "python": made["python"],
        "packages": made["packages"],
        "processor": f"{made['processor']}, {made['cores']} cores",
    }


def render(
    recording: Recording,
    estimates: Sequence[Estimate],
    metrics: Sequence[Metric],
    facts: Mapping[str, object],
    figures: Sequence[FigureSpec] = (),
    simulated: SimulatedRun | None = None,
    stages: Mapping[str, Cost] | None = None,
) -> str:
    """The page of a run. ``facts`` are printed key by key (seed, versions, …); its ``command`` is the command
    line that made the run. ``simulated`` is what only a simulator knows, ``stages`` what each stage cost.
    Everything that comes from outside is escaped."""
    judged, table, live = headline(metrics), tabulate(metrics), None
    if estimates:
        methods = [estimate.method for estimate in estimates]
        first = judged.best if judged else None
        if first in (None, BASELINE):  # dead reckoning has nothing to show
            first = OURS if OURS in methods else methods[-1]
        live = Markup(script_safe(live_content(recording, estimates, first, simulated)))
    return template("report.html.j2").render(
        recording=recording,
        spoilt=told(recording),
        verdict=verdict(metrics, estimates),
        scores=scores(judged, table.methods),
        judged=judged and judged.words[0].upper() + judged.words[1:],
        table=table,
        baseline=BASELINE,
        figures=[(figure, data_address(figure.files["png"])) for figure in figures],
        command=facts.get("command"),
        facts={key: value for key, value in facts.items() if key != "command"},
        stages=stages,
        live=live,
        style=Markup(style()),
        script=Markup(script()),
    )  # fmt: skip
