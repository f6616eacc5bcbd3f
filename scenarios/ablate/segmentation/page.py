"""The study as one HTML file that opens without a network."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from scenarios.ablate.segmentation import figures
from scenarios.ablate.segmentation.findings import Findings, correlations
from scenarios.ablate.segmentation.table import PRINTED, cells, difference_table, notes, scenario_table
from scenarios.ablate.segmentation.trials import NEVER, TRUTH
from scenarios.report.html import environment, own_style
from scenarios.report.style import png
from slam.odometry.confidence import MEASURES

if TYPE_CHECKING:
    from matplotlib.figure import Figure


class Picture(NamedTuple):
    """A figure: its file's name, what it shows in words, and the PNG."""

    name: str
    caption: str
    png: bytes

    @property
    def base64(self) -> str:
        """The PNG as a page has it."""
        return base64.b64encode(self.png).decode("ascii")


def draw_pictures(findings: Findings) -> list[Picture]:
    """The figures of the study."""
    drives, names, values = findings.drives, list(findings.names), findings.values
    shown = [name for name in ("trace2", "neg_matches", "combined") if name in names]
    drawn: dict[str, tuple[str, Figure]] = {
        "precision_recall": (
            "Precision over recall by scenario, all steps; those without a match tie at the top",
            figures.curves(drives, names),
        )
    }
    if any(np.isfinite(column).any() for column in values["ate_rmse"].values()):
        drawn["downstream"] = (
            "Position error and map of all drives, by the measure that cuts; medians of each scenario",
            figures.downstream(drives, values),
        )
    drawn["correlation"] = (
        "Rank correlations of the measures with each other and with the true error, mean over drives",
        figures.correlation(correlations(drives, names), names),
    )
    drawn["timeline"] = (
        "Confidence over the drive with the truth added (Formsma's figure 5.3): "
        f"{drives[0].scenario}, seed {drives[0].seed}",
        figures.timeline(drives[0].steps, shown),
    )
    return [Picture(name, caption, png(figure)) for name, (caption, figure) in drawn.items()]


def render(
    findings: Findings,
    verdict: Sequence[str],
    pictures: Sequence[Picture],
    command: str,
    cost: str,
    thorough: bool,
) -> str:
    """The page. ``command`` made it, ``cost`` tells what it took."""
    meanings = {name: " ".join((MEASURES[name].__doc__ or "").split()) for name in findings.names}
    if NEVER in findings.values["ate_rmse"]:
        meanings[NEVER] = "Reference: nothing is cut."
        meanings[TRUTH] = "Reference: just what was truly lost is cut."
    template = environment(Path(__file__).parent).get_template("page.html.j2")
    return template.render(
        style=own_style(),
        findings=findings,
        verdict=verdict,
        scores=PRINTED.values(),
        cells=cells,
        notes=notes(findings),
        pictures=pictures,
        by_scenario=scenario_table(findings),
        sure=difference_table("larger AUC", "by [95 %]", findings.ranking, ratios=False),
        sure_maps=difference_table("larger position error", "times [95 %]", findings.mapping, ratios=True),
        meanings=meanings,
        command=command,
        cost=cost,
        thorough=thorough,
    )
