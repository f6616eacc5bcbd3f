"""The study's figures, and all of it as one HTML file that opens without a network."""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from scenarios.ablate.segmentation.findings import Findings, ScoredDrive, correlations
from scenarios.ablate.segmentation.table import PRINTED, cells, difference_table, notes, scenario_table
from scenarios.ablate.segmentation.trials import NEVER, TRUTH, Steps
from scenarios.evaluation.detection import precision_recall
from scenarios.report.html import TEMPLATES, read, template
from scenarios.report.style import FONT, LEFT, RIGHT, WIDTH, grid, png
from slam.colours import BLACK, BLUE, GREEN, GREY, ORANGE, SKY, VERMILLION
from slam.odometry.confidence import MEASURES
from slam.odometry.segmentation import THRESHOLDS
from slam.se2 import Array

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

COLOURS = {"trace2": ORANGE, "det2": SKY, "neg_matches": VERMILLION, "innovation": GREEN, "combined": BLUE}
"""Measures with a colour of their own; the others are grey."""
CUTTER_COLOURS = COLOURS | {NEVER: "white", TRUTH: "white"}


def _figure(height: float) -> Figure:
    from matplotlib.figure import Figure

    return Figure(figsize=(WIDTH, height), layout="constrained")


def _add_legend(figure: Figure, entries: Sequence[tuple[str, dict[str, Any]]], loc: Any) -> None:
    """Words and the style of their line, under the figure."""
    from matplotlib.lines import Line2D

    handles = [Line2D([], [], label=words, **style) for words, style in entries]
    figure.legend(handles=handles, loc=loc, ncols=len(handles), frameon=False, fontsize=9)


def _add_grid(ax: Axes, axis: Any = "both") -> None:
    ax.tick_params(labelsize=FONT["tick"])
    ax.grid(axis=axis, color=GREY, linewidth=0.4, alpha=0.6)


def curves(drives: Sequence[ScoredDrive], names: Sequence[str]) -> Figure:
    """Precision over recall of every measure, all steps of a scenario's drives together."""
    scenarios = list(dict.fromkeys(drive.scenario for drive in drives))
    columns = min(len(scenarios), 2)
    rows = -(-len(scenarios) // columns)
    figure = _figure(3.9 * rows + 0.5)
    axes = figure.subplots(rows, columns, squeeze=False, sharex=True, sharey=True)
    for ax in axes.flat[len(scenarios) :]:
        ax.set_axis_off()
    for ax, scenario in zip(axes.flat, scenarios, strict=False):
        _draw_curves(ax, scenario, [d.steps for d in drives if d.scenario == scenario], names)
    for ax in axes[-1]:
        ax.set_xlabel("recall: share of the lost steps found", fontsize=FONT["label"])
    for ax in axes[:, 0]:
        ax.set_ylabel("precision: share of those called lost that are", fontsize=FONT["label"])
    entries: list[tuple[str, dict[str, Any]]] = [
        (name, {"color": colour, "linewidth": 1.8}) for name, colour in COLOURS.items() if name in names
    ]
    if set(names) - set(COLOURS):
        entries.append(("the others", {"color": GREY, "linewidth": 0.8}))
    entries.append(("knows nothing", {"color": BLACK, "linewidth": 0.8, "linestyle": ":"}))
    _add_legend(figure, entries, "outside lower center")
    return figure


def _draw_curves(ax: Axes, scenario: str, steps: Sequence[Steps], names: Sequence[str]) -> None:
    lost = np.concatenate([one.lost for one in steps])
    ax.set_title(f"{scenario}: {lost.sum()} of {len(lost)} steps lost", fontsize=FONT["title"])
    ax.set_xlim(0.0, 1.0)
    ax.set_ylim(0.0, 1.02)
    _add_grid(ax)
    if not lost.any():
        return
    ax.axhline(lost.mean(), color=BLACK, linewidth=0.8, linestyle=":")
    for name in sorted(names, key=lambda name: list(COLOURS).index(name) if name in COLOURS else -1):
        values = np.concatenate([one.columns[name] for one in steps])
        if np.isnan(values).any():
            continue
        precision, recall, _ = precision_recall(values, lost)
        ax.plot(
            np.concatenate([[0.0], recall]),
            np.concatenate([precision[:1], precision]),
            color=COLOURS.get(name, GREY),
            linewidth=1.8 if name in COLOURS else 0.8,
            drawstyle="steps-pre",  # the area below is the average precision, ties and all
            zorder=3 if name in COLOURS else 1,
        )


def downstream(drives: Sequence[ScoredDrive], values: Mapping[str, Mapping[str, Array]]) -> Figure:
    """Position error and map of every drive, by what did the cutting; the best median is on top."""
    cutters = [name for name, column in values["ate_rmse"].items() if np.isfinite(column).any()]
    cutters.sort(key=lambda name: -_median(values["ate_rmse"][name]))
    places = np.arange(1, len(cutters) + 1)
    figure = _figure(0.27 * len(cutters) + 1.4)
    left, right = figure.subplots(1, 2, sharey=True)
    for ax, score, words in (
        (left, "ate_rmse", "position error [m]"),
        (right, "map_f1", "share of walls right (map_f1)"),
    ):
        data = [values[score][name][np.isfinite(values[score][name])] for name in cutters]
        boxes = ax.boxplot(data, orientation="horizontal", widths=0.6, showfliers=False, patch_artist=True)
        for box, name in zip(boxes["boxes"], cutters, strict=True):
            box.set(facecolor=CUTTER_COLOURS.get(name, GREY), alpha=0.55, linewidth=0.7)
        for line in boxes["medians"]:
            line.set(color=BLACK, linewidth=1.6)
        for k, scenario in enumerate(dict.fromkeys(drive.scenario for drive in drives)):
            rows = [drive.scenario == scenario for drive in drives]
            medians = [_median(values[score][name][rows]) for name in cutters]
            label, marker = f"median of {scenario}", "osD^vPX*"[k % 8]
            ax.plot(medians, places, marker, ms=4, color=BLACK, markerfacecolor="white", label=label)
        ax.set_xlabel(words, fontsize=FONT["label"])
        _add_grid(ax, "x")
    left.set_xscale("log")
    left.xaxis.set_major_formatter("{x:g}")
    left.xaxis.set_minor_formatter("{x:g}")
    left.tick_params(axis="x", which="minor", labelsize=FONT["tick"], labelrotation=45)
    left.set_yticks(places, cutters, fontsize=FONT["label"])
    handles, labels = left.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=len(labels), frameon=False, fontsize=9)
    return figure


def _median(values: Array) -> float:
    """Of what is there; NaN where nothing is."""
    return float(np.nanmedian(values)) if np.isfinite(values).any() else float("nan")


def correlation(matrix: Array, names: Sequence[str]) -> Figure:
    """Rank correlations ``(M + 1, M + 1)`` of measures ``names (M,)`` and, last, the true error."""
    labels = [*names, "true error"]
    figure = _figure(0.62 * WIDTH)
    ax = figure.subplots()
    image = ax.imshow(matrix, cmap="RdBu_r", vmin=-1.0, vmax=1.0, aspect="auto")
    for i, j in np.argwhere(np.isfinite(matrix)):
        colour = "white" if abs(matrix[i, j]) > 0.6 else BLACK
        ax.text(j, i, f"{matrix[i, j]:.2f}", ha="center", va="center", fontsize=7, color=colour)
    ax.set_xticks(range(len(labels)), labels, rotation=45, ha="right", fontsize=FONT["tick"])
    ax.set_yticks(range(len(labels)), labels, fontsize=FONT["tick"])
    figure.colorbar(image, ax=ax, label="Spearman's rank correlation", fraction=0.03)
    return figure


def timeline(steps: Steps, names: Sequence[str]) -> Figure:
    """Formsma's figure 5.3 with truth added: error and confidence of every step of a drive."""
    figure, axes = grid(len(names) + 1, 1, WIDTH - LEFT - RIGHT, 1.6, 0.0, 0.2)
    _draw_timeline(axes[0], steps, np.maximum(steps.error, 1e-3), "true error / failure", 1.0)
    for ax, name in zip(axes[1:], names, strict=True):
        _draw_timeline(ax, steps, steps.columns[name], name, THRESHOLDS.get(name))
    for ax in axes[:-1]:
        ax.tick_params(labelbottom=False)
    axes[-1].set_xlabel("scan", fontsize=FONT["label"])
    entries: list[tuple[str, dict[str, Any]]] = [
        ("value", {"color": BLACK, "linewidth": 0.8}),
        ("truly lost", {"color": VERMILLION, "linewidth": 5.0, "alpha": 0.35}),
        ("no match", {"color": BLUE, "linestyle": "none", "marker": "o", "markersize": 5}),
        ("threshold", {"color": GREEN, "linewidth": 1.0, "linestyle": "--"}),
    ]
    _add_legend(figure, entries, "lower center")
    return figure


def _draw_timeline(ax: Axes, steps: Steps, values: Array, label: str, threshold: float | None) -> None:
    """One panel; logarithmic where all is positive."""
    for scan in steps.scan[steps.lost]:
        ax.axvline(scan, color=VERMILLION, alpha=0.35, linewidth=1.4, zorder=0)
    finite = np.isfinite(values)
    positive = np.all(values[finite] > 0.0)
    ax.set_yscale("log" if positive else "linear")
    ax.plot(steps.scan, np.where(finite, values, np.nan), color=BLACK, linewidth=0.6)
    unmatched = steps.scan[~steps.matched]
    top = ax.get_xaxis_transform()
    ax.plot(unmatched, np.ones(len(unmatched)), "o", color=BLUE, ms=4, clip_on=False, zorder=5, transform=top)
    if positive:  # a trace of 1e13 m² would leave no room for the others
        ax.set_ylim(top=min(ax.get_ylim()[1], 1e3 * (threshold or 1.0)))
    if threshold is not None and np.isfinite(threshold):
        ax.axhline(threshold, color=GREEN, linestyle="--", linewidth=1.0)
    ax.set_ylabel(label, fontsize=FONT["label"])
    ax.set_xlim(steps.scan[0], steps.scan[-1])
    ax.tick_params(labelsize=FONT["tick"])


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
    drawn = [
        (
            "precision_recall",
            "Precision over recall by scenario, all steps; those without a match tie at the top",
            curves(drives, names),
        ),
        (
            "correlation",
            "Rank correlations of the measures with each other and with the true error, mean over drives",
            correlation(correlations(drives, names), names),
        ),
        (
            "timeline",
            "Confidence over the drive with the truth added (Formsma's figure 5.3): "
            f"{drives[0].scenario}, seed {drives[0].seed}",
            timeline(drives[0].steps, shown),
        ),
    ]
    if any(np.isfinite(column).any() for column in values["ate_rmse"].values()):
        caption = "Position error and map of all drives, by the measure that cuts; medians of each scenario"
        drawn.insert(1, ("downstream", caption, downstream(drives, values)))
    return [Picture(name, caption, png(figure)) for name, caption, figure in drawn]


def render(findings: Findings, verdict: Sequence[str], pictures: Sequence[Picture], **about: object) -> str:
    """The page, ``about`` the ``command`` that made it, its ``cost`` in words, and if it was ``thorough``."""
    meanings = {name: " ".join((MEASURES[name].__doc__ or "").split()) for name in findings.names}
    if NEVER in findings.values["ate_rmse"]:
        meanings[NEVER] = "Reference: nothing is cut."
        meanings[TRUTH] = "Reference: just what was truly lost is cut."
    return template("page.html.j2", Path(__file__).parent).render(
        style=read(TEMPLATES / "page.css"),
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
        **about,
    )
