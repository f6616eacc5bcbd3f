"""A run as one HTML file that opens without a network."""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from scenarios.estimate import Estimate
from scenarios.evaluation.metric import Metric
from scenarios.report import figures
from scenarios.report.style import png
from scenarios.report.table import tabulate
from scenarios.report.verdict import headline, verdict
from slam.recording import Recording

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from sim.record import SimulatedRun

TEMPLATES = Path(__file__).parent / "templates"


@dataclass(frozen=True)
class Picture:
    """A figure in the page: PNG as base64, what it shows in words, and its caption."""

    data: str
    alt: str
    caption: str


def render(
    recording: Recording,
    estimates: Sequence[Estimate],
    metrics: Sequence[Metric],
    run: Mapping[str, object],
    simulated: SimulatedRun | None = None,
) -> str:
    """The page of a run.

    ``run`` is told as it is, key by key (seed, versions, what else matters); its ``command`` is the command
    line that made the run. ``simulated`` is what only a simulator knows, for pictures of its world.
    Everything that comes from outside is escaped.
    """
    import jinja2

    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(TEMPLATES),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template("report.html.j2").render(
        recording=recording,
        verdict=verdict(metrics),
        table=tabulate(metrics),
        pictures=pictures(recording, estimates, metrics) + world_pictures(simulated, estimates),
        command=run.get("command"),
        run={key: value for key, value in run.items() if key != "command"},
    )


def titles(estimates: Sequence[Estimate], metrics: Sequence[Metric]) -> dict[str, str]:
    """Method -> its name and its score in the metric the run is judged by."""
    judged = headline(metrics)
    scores = {m.method: m.value for m in metrics if judged and m.name == judged[0] and m.value is not None}
    short = {"ate_rmse": "ATE", "relation_trans_mean": "relations"}
    return {
        e.method: f"{e.method}\n{short[judged[0]]} {scores[e.method]:.3f} m"
        if judged and e.method in scores
        else e.method
        for e in estimates
    }


def pictures(recording: Recording, estimates: Sequence[Estimate], metrics: Sequence[Metric]) -> list[Picture]:
    """The figures of a run: maps, trajectories, and the confidence of every method that has a track."""
    if not estimates:
        return []
    names = titles(estimates, metrics)
    listed = ", ".join(estimate.method for estimate in estimates)
    over = "" if recording.truth is None else " over truth, after SE(2) alignment"
    result = [
        _picture(figures.maps(recording, estimates, names), f"Maps of {listed}{over}", f"Maps{over}."),
        _picture(
            figures.trajectories(recording, estimates, names),
            f"Trajectories of {listed}{over}",
            f"Trajectories{over}.",
        ),
    ]
    for estimate in estimates:
        if estimate.track is not None:
            what = f"Confidence of {estimate.method}'s scan matches over the drive"
            result.append(_picture(figures.confidence(estimate), what, f"{what}."))
    return result


def world_pictures(simulated: SimulatedRun | None, estimates: Sequence[Estimate]) -> list[Picture]:
    """The world from above, the drive and where the Weighted Scan Matcher failed; a scan from the side."""
    if simulated is None:
        return []
    from scenarios.report import world

    matcher = next((estimate for estimate in estimates if estimate.method == "wsm"), None)
    return [
        _picture(
            world.from_above(simulated, matcher),
            "The simulated world from above, the driven path coloured by the robot's tilt",
            "The world and the drive, coloured by tilt. Shaded: uneven ground (brown) and smoke (grey).",
        ),
        _picture(
            world.from_the_side(simulated),
            "One tilted scan from the side: where its beams meet the floor or a wall",
            "The scan with the most nose-down pitch, from the side: what a tilted laser takes for a wall.",
        ),
    ]


def _picture(figure: Figure, alt: str, caption: str) -> Picture:
    return Picture(base64.b64encode(png(figure)).decode("ascii"), alt, caption)
