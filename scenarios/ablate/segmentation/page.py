"""The study as one HTML file that opens without a network."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from scenarios.ablate.segmentation import figures
from scenarios.ablate.segmentation.cutting import NEVER, TRUTH
from scenarios.ablate.segmentation.findings import Findings
from scenarios.ablate.segmentation.scores import correlations
from scenarios.ablate.segmentation.statistics import Comparison, Mean
from scenarios.ablate.segmentation.table import ABSENT, COLUMNS, cells, notes
from scenarios.ablate.segmentation.verdict import between
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


def pictures(found: Findings) -> list[Picture]:
    """The figures of the study."""
    names = list(found.names)
    result = [
        _picture(
            "precision_recall",
            figures.curves(found.drives, names),
            "Precision over recall by scenario, all steps; those without a match tie at the top",
        ),
        _picture(
            "correlation",
            figures.correlation(correlations(found.drives, names), names),
            "Rank correlations of the measures with each other and with the true error, mean over drives",
        ),
    ]
    if any(np.isfinite(column).any() for column in found.values["ate_rmse"].values()):
        result.insert(1, _picture(
            "downstream",
            figures.downstream(found.drives, found.values),
            "Position error and map of all drives, by the measure that cuts; medians of each scenario",
        ))  # fmt: skip
    first = found.drives[0]
    shown = [name for name in ("trace2", "neg_matches", "combined") if name in names]
    result.append(
        _picture(
            "timeline",
            figures.timeline(first.steps, shown),
            f"Confidence over the drive with the truth added (Formsma's figure 5.3): {first.scenario}, seed "
            f"{first.seed}",
        )
    )
    return result


def render(
    found: Findings,
    verdict: Sequence[str],
    shown: Sequence[Picture],
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
    sure, sure_maps = _sure(found.ranking), _sure(found.mapping)
    return environment.get_template("page.html.j2").render(
        found=found, verdict=verdict, columns=COLUMNS, cells=cells, notes=notes(found), pictures=shown,
        leaders={scenario: _leader(found, scenario) for scenario in found.scenarios}, interval=_interval,
        sure=sure, compared=len(found.ranking), difference=_difference,
        sure_maps=sure_maps, compared_maps=len(found.mapping), ratio=_ratio,
        meanings=meanings(found), command=command, cost=cost, thorough=thorough,
    )  # fmt: skip


def meanings(found: Findings) -> dict[str, str]:
    """What each measure is, as its function says."""
    told = {name: " ".join((MEASURES[name].__doc__ or "").split()) for name in found.names}
    if NEVER in found.values["ate_rmse"]:
        told[NEVER] = "Reference: nothing is cut."
        told[TRUTH] = "Reference: just what was truly lost is cut."
    return told


def _picture(name: str, figure: Figure, caption: str) -> Picture:
    return Picture(name, base64.b64encode(png(figure)).decode("ascii"), caption, f"{caption}.")


def _leader(found: Findings, scenario: str) -> str:
    there = {name: one.value for name, one in found.by_scenario[scenario].items() if np.isfinite(one.value)}
    return max(there, key=lambda name: there[name]) if there else ""


def _sure(comparisons: Sequence[Comparison]) -> list[Comparison]:
    """The significant ones, the larger first."""
    found = [one for one in comparisons if one.significant]
    turned = [
        one if one.difference.value > 0.0 else between(comparisons, one.second, one.first) for one in found
    ]
    return sorted((one for one in turned if one is not None), key=lambda one: -one.difference.value)


def _interval(one: Mean) -> str:
    if not np.isfinite(one.value):
        return ABSENT
    if not np.isfinite(one.low):
        return f"{one.value:.3f}"
    return f"{one.value:.3f} [{one.low:.3f}, {one.high:.3f}]"


def _difference(one: Comparison) -> str:
    return _interval(one.difference)


def _ratio(one: Comparison) -> str:
    d = one.difference
    return f"{np.exp(d.value):.2f} [{np.exp(d.low):.2f}, {np.exp(d.high):.2f}]"
