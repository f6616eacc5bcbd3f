"""A run as one HTML file that opens without a network."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from scenarios.evaluation.metric import Metric
from scenarios.report.album import Plate
from scenarios.report.assets import TEMPLATES, script, style
from scenarios.report.live.packed import picture
from scenarios.report.live.run import script_safe, told
from scenarios.report.table import BASELINE, tabulate
from scenarios.report.verdict import best_method, headline, scores, verdict
from slam.recording import Recording
from stitch.mapping.estimate import Estimate

if TYPE_CHECKING:
    import jinja2

    from scenarios.stages import Cost
    from sim.record import SimulatedRun


def render(
    recording: Recording,
    estimates: Sequence[Estimate],
    metrics: Sequence[Metric],
    run: Mapping[str, object],
    plates: Sequence[Plate] = (),
    simulated: SimulatedRun | None = None,
    stages: Mapping[str, Cost] | None = None,
) -> str:
    """The page of a run, with its figures ``plates``.

    ``run`` is told as it is, key by key (seed, versions, what else matters); its ``command`` is the command
    line that made the run. ``simulated`` is what only a simulator knows, ``stages`` what each stage cost.
    Everything that comes from outside is escaped.
    """
    from markupsafe import Markup

    judged = headline(metrics)
    table = tabulate(metrics)
    live = (
        script_safe(told(recording, estimates, _shown_first(estimates, metrics), simulated))
        if estimates
        else None
    )
    return environment().get_template("report.html.j2").render(
        recording=recording,
        verdict=verdict(metrics, estimates),
        scores=scores(metrics, list(dict.fromkeys(metric.method for metric in metrics))),
        judged=judged and judged[1][0].upper() + judged[1][1:],
        table=table,
        kinds=table.kinds(),
        baseline=BASELINE,
        pictures=[_shown(plate) for plate in plates],
        command=run.get("command"),
        run={key: value for key, value in run.items() if key != "command"},
        stages=stages,
        told=live and Markup(live),
        style=Markup(style()),
        script=Markup(script()),
    )  # fmt: skip


def environment() -> jinja2.Environment:
    """Templates in which everything is escaped that is not told to be safe."""
    import jinja2

    return jinja2.Environment(
        loader=jinja2.FileSystemLoader(TEMPLATES),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )


def _shown_first(estimates: Sequence[Estimate], metrics: Sequence[Metric]) -> str | None:
    """The method to open with: the best; where that is dead reckoning, which has nothing to show, or none is
    scored, ours, else the last."""
    best = best_method(metrics)
    if best not in (None, BASELINE):
        return best
    methods = [estimate.method for estimate in estimates]
    return "slamstitch" if "slamstitch" in methods else methods[-1] if methods else None


def _shown(plate: Plate) -> dict[str, Any]:
    return {"data": picture(plate.png), "alt": plate.alt, "caption": plate.caption, "size": plate.size}
