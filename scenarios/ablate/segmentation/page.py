"""The study as one HTML file that opens without a network."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from scenarios.ablate.segmentation import figures
from scenarios.ablate.segmentation.findings import Findings
from scenarios.ablate.segmentation.scores import correlations
from scenarios.ablate.segmentation.table import COLUMNS, cells, difference_table, notes, scenario_table
from scenarios.ablate.segmentation.trials import NEVER, TRUTH
from scenarios.ablate.statistics import PairedDifference
from scenarios.report.style import png
from slam.odometry.confidence import MEASURES

if TYPE_CHECKING:
    from matplotlib.figure import Figure

HERE = Path(__file__).parent
STYLES = HERE.parents[1] / "report" / "templates"


@dataclass(frozen=True)
class Picture:
    """A figure: its file's name, the PNG as base64, what it shows in words, and its caption."""

    name: str
    data: str
    alt: str
    caption: str

    @classmethod
    def of(cls, name: str, figure: Figure, caption: str) -> Picture:
        """A figure under a name."""
        return cls(name, base64.b64encode(png(figure)).decode("ascii"), caption, f"{caption}.")


def draw_pictures(findings: Findings) -> list[Picture]:
    """The figures of the study."""
    drives, names = findings.drives, list(findings.names)
    pictures = [
        Picture.of(
            "precision_recall",
            figures.curves(drives, names),
            "Precision over recall by scenario, all steps; those without a match tie at the top",
        )
    ]
    if any(np.isfinite(column).any() for column in findings.values["ate_rmse"].values()):
        caption = "Position error and map of all drives, by the measure that cuts; medians of each scenario"
        pictures.append(Picture.of("downstream", figures.downstream(drives, findings.values), caption))
    shown = [name for name in ("trace2", "neg_matches", "combined") if name in names]
    pictures += [
        Picture.of(
            "correlation",
            figures.correlation(correlations(drives, names), names),
            "Rank correlations of the measures with each other and with the true error, mean over drives",
        ),
        Picture.of(
            "timeline",
            figures.timeline(drives[0].steps, shown),
            "Confidence over the drive with the truth added (Formsma's figure 5.3): "
            f"{drives[0].scenario}, seed {drives[0].seed}",
        ),
    ]
    return pictures


def render(
    findings: Findings,
    verdict: Sequence[str],
    pictures: Sequence[Picture],
    command: str,
    cost: str,
    thorough: bool,
) -> str:
    """The page. ``command`` made it, ``cost`` tells what it took."""
    import jinja2

    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader([HERE, STYLES]),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    sure, sure_maps = _significant(findings.ranking), _significant(findings.mapping)
    return environment.get_template("page.html.j2").render(
        findings=findings,
        verdict=verdict,
        columns=COLUMNS,
        cells=cells,
        notes=notes(findings),
        pictures=pictures,
        by_scenario=scenario_table(findings),
        sure=difference_table("larger AUC", "by [95 %]", sure, ratios=False),
        sure_maps=difference_table("larger position error", "times [95 %]", sure_maps, ratios=True),
        meanings=meanings(findings),
        command=command,
        cost=cost,
        thorough=thorough,
    )


def meanings(findings: Findings) -> dict[str, str]:
    """What each measure is, as its function says."""
    texts = {name: " ".join((MEASURES[name].__doc__ or "").split()) for name in findings.names}
    if NEVER in findings.values["ate_rmse"]:
        texts[NEVER] = "Reference: nothing is cut."
        texts[TRUTH] = "Reference: just what was truly lost is cut."
    return texts


def _significant(differences: Sequence[PairedDifference]) -> list[PairedDifference]:
    """The significant ones, the larger first."""
    found = [one for one in differences if one.significant]
    positive = [one if one.difference.value > 0.0 else one.swapped() for one in found]
    return sorted(positive, key=lambda one: -one.difference.value)
