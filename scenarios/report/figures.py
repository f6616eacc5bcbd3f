"""Figures of a run: maps, trajectories and confidence. Each function returns a matplotlib ``Figure``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from scenarios.evaluation.maps import RESOLUTION, cells_found, map_at, occupied_cells, true_map
from scenarios.evaluation.trajectory import aligned
from scenarios.report.cuts import cuts
from scenarios.report.style import (
    BLACK,
    BLUE,
    FONT,
    GREY,
    LEFT,
    ORANGE,
    RIGHT,
    SKY,
    TICKS,
    VERMILLION,
    WIDTH,
    grid,
    panels,
    titled,
)
from slam.mapping.occupancy import Grid
from slam.recording import Recording
from slam.se2 import Array
from stitch.mapping.estimate import Estimate

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

View = tuple[float, float, float, float]
"""``x_min, x_max, y_min, y_max`` m."""
MARGIN = 1.0
"""Free space around a drawing [m]."""


def maps(recording: Recording, estimates: Sequence[Estimate], titles: Mapping[str, str]) -> Figure:
    """The maps of all methods side by side; ``titles`` by method.

    With truth every map is aligned to it and its walls are told apart: found, wrong, missed.
    """
    truth = true_map(recording)
    truth_cells = None if truth is None else occupied_cells(truth)
    drawn = [_cells(recording, estimate) for estimate in estimates]
    shown, aspect = views([_centres(cells if truth is None else truth_cells) for cells in drawn])
    figure, axes = panels(len(estimates), aspect)
    for ax, estimate, cells, view in zip(axes, estimates, drawn, shown, strict=True):
        ax.axis(view)
        _draw_walls(ax, cells, truth_cells, _marker_size(ax, view))
        titled(ax, titles[estimate.method])
        _tell_of_walls_outside(ax, cells, view)
    if truth_cells is not None:
        legend(
            figure, [("wall found", BLACK), ("drawn where there is none", BLUE), ("true wall missed", ORANGE)]
        )
    return figure


def trajectories(recording: Recording, estimates: Sequence[Estimate], titles: Mapping[str, str]) -> Figure:
    """The path of every method, over the true one where there is truth; ``titles`` by method."""
    truth = recording.truth
    paths = [estimate.poses if truth is None else aligned(estimate.poses, truth) for estimate in estimates]
    shown, aspect = views([path if truth is None else truth for path in paths])
    figure, axes = panels(len(estimates), aspect)
    for ax, estimate, path, view in zip(axes, estimates, paths, shown, strict=True):
        ax.axis(view)
        if truth is not None:
            ax.plot(truth[:, 0], truth[:, 1], color=ORANGE, linewidth=3.0, solid_capstyle="round")
        ax.plot(path[:, 0], path[:, 1], color=BLACK, linewidth=0.9)
        ax.plot(*path[0, :2], marker="o", color=BLUE, markersize=6, linestyle="none")
        titled(ax, titles[estimate.method])
    entries = [("estimate", BLACK), ("its start", BLUE)]
    legend(figure, entries if truth is None else [("truth", ORANGE), *entries])
    return figure


CONFIDENCE = (
    ("trace2", "trace [m²]", "log"),
    ("det2", "determinant [m⁴]", "log"),
    ("matches", "matches", "linear"),
)


def confidence(estimate: Estimate) -> Figure:
    """The confidence of every match of an estimate's track over the drive.

    Steps without a single match are red dots on the x axis, cuts vertical lines: scans that belong to no
    segment (Formsma's figure 5.3). Where two segments touch, the drive was divided but not cut. Raises
    ``ValueError`` when the estimate has no track.
    """
    if estimate.track is None:
        raise ValueError(f"{estimate.method} has no track to draw the confidence of")
    track = estimate.track
    tried = ~np.isnan(track.confidence["trace2"])
    lost = np.flatnonzero(tried & (track.matches == 0))
    gaps = cuts(estimate.submaps)
    figure, axes = grid(len(CONFIDENCE), 1, WIDTH - LEFT - RIGHT, 1.75, 0.0, 0.15)
    for ax, (name, label, scale) in zip(axes, CONFIDENCE, strict=True):
        values = track.matches.astype(float) if name == "matches" else track.confidence[name]
        _confidence_panel(ax, np.flatnonzero(tried), values[tried], lost, scale)
        ax.set_ylabel(label, fontsize=FONT["label"])
        _shade(ax, gaps)
        ax.set_xlim(-0.5, len(track) - 0.5)
        ax.tick_params(labelbottom=ax is axes[-1])
    axes[-1].set_xlabel("scan", fontsize=FONT["label"])
    titled(
        axes[0],
        f"{estimate.method}: {len(lost)} of {tried.sum()} steps tried have no match, {len(gaps)} cuts",
    )
    legend(figure, [("matched step", BLACK), ("step without a match", VERMILLION), ("cut", SKY)])
    return figure


def _shade(ax: Axes, gaps: Sequence[tuple[int, int]]) -> None:
    """Bands over stretches of scans, first and last."""
    from matplotlib.collections import PolyCollection

    bands = [
        [(first - 0.5, 0.0), (first - 0.5, 1.0), (last + 0.5, 1.0), (last + 0.5, 0.0)] for first, last in gaps
    ]
    style: dict[str, Any] = {
        "facecolors": SKY,
        "edgecolors": SKY,
        "alpha": 0.5,
        "linewidths": 1.5,
        "zorder": 0,
    }
    shaded = PolyCollection(bands, transform=ax.get_xaxis_transform(), **style)
    ax.add_collection(shaded, autolim=False)


def _grid(recording: Recording, poses: Array) -> Grid:
    return map_at(recording, poses if recording.truth is None else aligned(poses, recording.truth))


def _cells(recording: Recording, estimate: Estimate) -> np.ndarray | None:
    """Occupied cells ``(n, 2)`` of a method's map, None where it is too large to draw."""
    try:
        return occupied_cells(_grid(recording, estimate.poses))
    except ValueError:
        return None


def _centres(cells: np.ndarray | None) -> Array:
    return np.zeros((0, 2)) if cells is None else (cells + 0.5) * RESOLUTION


def views(drawings: Sequence[Array]) -> tuple[list[View], float]:
    """What to show of each set of points ``(n, >= 2)`` m, of one height over width, and that ratio."""
    boxes = [_box(points[:, :2]) for points in drawings]
    aspect = float(np.clip(np.median([size[1] / size[0] for _, size in boxes]), 0.3, 2.5))
    views = []
    for (x, y), size in boxes:
        half = max(size[0], size[1] / aspect) / 2.0
        views.append((float(x - half), float(x + half), float(y - half * aspect), float(y + half * aspect)))
    return views, aspect


def _box(points: Array) -> tuple[Array, Array]:
    """Centre and size ``(2,)`` m of the box around points, with a margin."""
    low, high = (points.min(axis=0), points.max(axis=0)) if len(points) else (np.zeros(2), np.zeros(2))
    return (low + high) / 2.0, high - low + 2.0 * MARGIN


def _marker_size(ax: Axes, view: View) -> float:
    """Side of a cell on paper [pt], and at least what can be seen."""
    points = 72.0 * ax.get_position().width * ax.figure.bbox.width / ax.figure.dpi
    return max(1.4 * points * RESOLUTION / (view[1] - view[0]), 0.8)


def _draw_walls(ax: Axes, cells: np.ndarray | None, truth: np.ndarray | None, size: float) -> None:
    if cells is None:
        ax.text(
            0.5, 0.5, "map too large to draw", transform=ax.transAxes, ha="center", fontsize=FONT["label"]
        )
        return
    layers = [(cells, BLACK)]
    if truth is not None:
        found = cells_found(cells, truth)
        layers = [(truth[~cells_found(truth, cells)], ORANGE), (cells[~found], BLUE), (cells[found], BLACK)]
    for some, colour in layers:
        x, y = _centres(some).T
        style: dict[str, Any] = {"linestyle": "none", "marker": "s", "markersize": size, "markeredgewidth": 0}
        ax.plot(x, y, color=colour, rasterized=True, **style)


def _tell_of_walls_outside(ax: Axes, cells: np.ndarray | None, view: View) -> None:
    if cells is None or len(cells) == 0:
        return
    x, y = _centres(cells).T
    outside = np.mean((x < view[0]) | (x > view[1]) | (y < view[2]) | (y > view[3]))
    if outside >= 0.005:
        ax.text(
            0.02,
            0.02,
            f"{outside:.0%} of the walls lie outside",
            transform=ax.transAxes,
            fontsize=FONT["tick"],
        )


def _confidence_panel(ax: Axes, scans: np.ndarray, values: Array, lost: np.ndarray, scale: str) -> None:
    from matplotlib.ticker import LogLocator, NullLocator

    drawable = np.isfinite(values) & ((values > 0.0) if scale == "log" else True)
    ax.set_yscale(scale)
    if scale == "log":
        ax.yaxis.set_major_locator(LogLocator(numticks=TICKS))
        ax.yaxis.set_major_formatter("{x:.0e}")  # plain text: mathematics take ten times as long to set
    ax.yaxis.set_minor_locator(NullLocator())
    alone = drawable & ~np.append(False, drawable[:-1]) & ~np.append(drawable[1:], False)
    ax.plot(
        scans, np.where(drawable, values, np.nan), color=BLACK, linewidth=0.5,
        marker=".", markersize=2.5, markevery=alone,
    )  # fmt: skip
    if not np.any(drawable):
        ax.text(0.5, 0.5, "no step was matched", transform=ax.transAxes, ha="center", fontsize=FONT["label"])
    elif scale == "linear":
        ax.set_ylim(bottom=0.0)
    ax.plot(
        lost,
        np.zeros(len(lost)),
        transform=ax.get_xaxis_transform(),
        color=VERMILLION,
        marker="o",
        markersize=5,
        linestyle="none",
        clip_on=False,
        zorder=5,
    )
    ax.grid(axis="y", color=GREY, linewidth=0.4, alpha=0.6)


def legend(figure: Figure, entries: Sequence[tuple[str, str]]) -> None:
    """What each colour means, under the figure: entries (words, colour)."""
    from matplotlib.lines import Line2D

    handles = [
        Line2D([], [], color=colour, marker="s", linestyle="none", markersize=7, label=label)
        for label, colour in entries
    ]
    figure.legend(handles=handles, loc="lower center", ncols=len(handles), fontsize=9, frameon=False)
