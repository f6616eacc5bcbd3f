"""Figures of what a method answered: its map, its path, how sure it is of it, and its scan matches."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullLocator
from scipy.stats import chi2

from scenarios.evaluation.maps import RESOLUTION, cells_found, map_at, occupied_cells, true_map
from scenarios.evaluation.segmentation import segment_gaps
from scenarios.evaluation.trajectory import aligned
from scenarios.report.style import FONT, LEFT, RIGHT, TICKS, WIDTH, add_legend, box, grid, panels, set_title
from slam import se2
from slam.colours import BLACK, BLUE, GREY, ORANGE, SKY, VERMILLION
from slam.odometry.track import Verdict
from slam.recording import Recording
from slam.se2 import Array
from stitch.mapping.estimate import Estimate

MARGIN = 1.0
"""Free space around a drawing [m]."""
CHI2_2_95 = float(chi2.ppf(0.95, 2))
"""Squared Mahalanobis distance within which 95 % of a normal distribution in two dimensions lie."""
ELLIPSE_SCALE = 10
"""How much larger than true the ellipses are drawn: centimetres would not show."""
ELLIPSE_SPACING = 0.5
"""Path between two ellipses [m]."""
CENTRED: dict[str, Any] = {"fontsize": FONT["label"], "ha": "center"}
BAND: dict[str, Any] = {"facecolors": SKY, "edgecolors": SKY, "alpha": 0.5, "linewidths": 1.5}
CONFIDENCE = (
    ("trace2", "trace [m²]", "log"),
    ("det2", "determinant [m⁴]", "log"),
    ("matches", "matches", "linear"),
)


def draw_maps(recording: Recording, estimates: Sequence[Estimate], titles: Mapping[str, str]) -> Figure:
    """The maps of all methods side by side; ``titles`` by method. With truth every map is aligned to it and
    its walls are told apart: found, wrong, missed."""
    truth = true_map(recording)
    true_cells = None if truth is None else occupied_cells(truth)
    maps = [_wall_cells(recording, estimate) for estimate in estimates]
    shown = [_centres(cells if truth is None else true_cells) for cells in maps]
    figure, axes = _panels(shown, [titles[estimate.method] for estimate in estimates])
    for ax, cells in zip(axes, maps, strict=True):
        _draw_walls(ax, cells, true_cells)
    if true_cells is not None:
        add_legend(
            figure, [("wall found", BLACK), ("drawn where there is none", BLUE), ("true wall missed", ORANGE)]
        )
    return figure


def draw_trajectories(
    recording: Recording, estimates: Sequence[Estimate], titles: Mapping[str, str]
) -> Figure:
    """The path of every method, over the true one where there is truth; ``titles`` by method."""
    truth = recording.truth
    paths = [aligned(estimate.poses, truth) for estimate in estimates]
    shown = [path if truth is None else truth for path in paths]
    figure, axes = _panels(shown, [titles[estimate.method] for estimate in estimates])
    for ax, path in zip(axes, paths, strict=True):
        if truth is not None:
            ax.plot(truth[:, 0], truth[:, 1], color=ORANGE, linewidth=3.0, solid_capstyle="round")
        ax.plot(path[:, 0], path[:, 1], color=BLACK, linewidth=0.9)
        ax.plot(*path[0, :2], marker="o", color=BLUE, markersize=6, linestyle="none")
    entries = [("estimate", BLACK), ("its start", BLUE)]
    add_legend(figure, entries if truth is None else [("truth", ORANGE), *entries])
    return figure


def draw_uncertainty(
    recording: Recording, estimates: Sequence[Estimate], titles: Mapping[str, str]
) -> Figure:
    """The path of every method that has covariances, with ellipses of 95 %; red where nothing was matched
    (thesis, figure A.1)."""
    truth = recording.truth
    drawn = [
        (estimate, aligned(estimate.poses, truth), *stated)
        for estimate in estimates
        if (stated := covariance_of(estimate)) is not None
    ]
    shown = [path if truth is None else truth for _, path, _, _ in drawn]
    figure, axes = _panels(shown, [f"{titles[e.method]}; covariance of each {of}" for e, _, _, of in drawn])
    for ax, (estimate, path, covariance, _) in zip(axes, drawn, strict=True):
        rows = _spaced(path, np.isfinite(covariance[:, 0, 0]))
        outlines = ellipses(path[rows], to_map_axes(path[rows], covariance[rows]), ELLIPSE_SCALE)
        ax.add_collection(
            PolyCollection(list(outlines), facecolors=SKY, edgecolors="none", alpha=0.45, rasterized=True)
        )
        ax.plot(path[:, 0], path[:, 1], color=BLACK, linewidth=0.8)
        if estimate.track is not None:
            tried = estimate.track.verdict != Verdict.SKIPPED
            lost = path[tried & (estimate.track.matches == 0)][1:]
            ax.plot(lost[:, 0], lost[:, 1], linestyle="none", marker="o", markersize=3, color=VERMILLION)
    scaled = f"95 %, {ELLIPSE_SCALE} times as large"
    add_legend(figure, [("path", BLACK), (scaled, SKY), ("no match", VERMILLION)])
    return figure


def draw_confidence(estimate: Estimate) -> Figure:
    """The confidence of every match of an estimate's track over the drive. Steps without a single match are
    red dots on the x axis, cuts vertical bands: scans that belong to no segment (thesis, figure 5.3). Raises
    ``ValueError`` when the estimate has no track."""
    if estimate.track is None:
        raise ValueError(f"{estimate.method} has no track to draw the confidence of")
    track = estimate.track
    tried = ~np.isnan(track.confidence["trace2"])
    lost = np.flatnonzero(tried & (track.matches == 0))
    gaps = segment_gaps(estimate.submaps)
    corners = [[(a - 0.5, 0.0), (a - 0.5, 1.0), (b + 0.5, 1.0), (b + 0.5, 0.0)] for a, b in gaps]
    figure, axes = grid(len(CONFIDENCE), 1, WIDTH - LEFT - RIGHT, 1.75, 0.0, 0.15)
    for ax, (name, label, scale) in zip(axes, CONFIDENCE, strict=True):
        values = track.matches.astype(float) if name == "matches" else track.confidence[name]
        _confidence_panel(ax, np.flatnonzero(tried), values[tried], lost, scale)
        ax.set_ylabel(label, fontsize=FONT["label"])
        bands = PolyCollection(corners, transform=ax.get_xaxis_transform(), zorder=0, **BAND)
        ax.add_collection(bands, autolim=False)
        ax.set_xlim(-0.5, len(track) - 0.5)
        ax.tick_params(labelbottom=ax is axes[-1])
    axes[-1].set_xlabel("scan", fontsize=FONT["label"])
    counts = f"{len(lost)} of {tried.sum()} steps tried have no match, {len(gaps)} cuts"
    set_title(axes[0], f"{estimate.method}: {counts}")
    add_legend(figure, [("matched step", BLACK), ("step without a match", VERMILLION), ("cut", SKY)])
    return figure


def covariance_of(estimate: Estimate) -> tuple[Array, str] | None:
    """Covariance ``(N, 3, 3)`` in the body frame and of what: the pose where a method has marginals, else of
    the step from the scan each was matched to."""
    if estimate.covariance is not None:
        return estimate.covariance, "pose"
    if estimate.track is not None:
        return estimate.track.covariance, "step"
    return None


def to_map_axes(poses: Array, covariance: Array) -> Array:
    """Position covariances ``(..., 2, 2)`` m² in the map's axes from those ``(..., 3, 3)`` in the body frames
    of the ``poses (..., 3)``."""
    R = se2.rotation(poses[..., 2])
    return R @ covariance[..., :2, :2] @ np.swapaxes(R, -1, -2)


def ellipses(poses: Array, covariance: Array, scale: float = 1.0) -> Array:
    """Outlines ``(n, 33, 2)`` m that hold 95 %, ``scale`` times as large, of position covariances
    ``(n, 2, 2)`` m² around ``poses (n, 3)``."""
    values, vectors = np.linalg.eigh(covariance)
    axes = vectors * np.sqrt(CHI2_2_95 * np.maximum(values, 0.0))[:, None, :]
    around = np.linspace(0.0, 2.0 * np.pi, 33)
    circle = np.stack([np.cos(around), np.sin(around)])
    return poses[:, None, :2] + scale * np.swapaxes(axes @ circle, -1, -2)


def _panels(drawings: Sequence[Array], titles: Sequence[str]) -> tuple[Figure, list[Axes]]:
    """A panel for each set of points ``(n, >= 2)`` m, all of one height over width, which shows all of it."""
    boxes = [box(points[:, :2]) for points in drawings]
    sizes = [size + 2.0 * MARGIN for _, size in boxes]
    aspect = float(np.clip(np.median([height / width for width, height in sizes]), 0.3, 2.5))
    figure, axes = panels(len(boxes), aspect)
    for ax, ((x, y), _), (width, height), title in zip(axes, boxes, sizes, titles, strict=True):
        half = max(width, height / aspect) / 2.0
        ax.axis((float(x - half), float(x + half), float(y - half * aspect), float(y + half * aspect)))
        set_title(ax, title)
    return figure, axes


def _spaced(path: Array, known: np.ndarray) -> np.ndarray:
    """Rows ``(n,)`` about `ELLIPSE_SPACING` of path apart, of those ``known (N,)``."""
    rows = np.flatnonzero(known)
    bins = np.floor(se2.path_length(path)[rows] / ELLIPSE_SPACING)
    return rows[np.append(True, np.diff(bins) > 0.0)] if len(rows) else rows


def _wall_cells(recording: Recording, estimate: Estimate) -> np.ndarray | None:
    """Occupied cells ``(n, 2)`` of a method's map, None where it is too large to draw."""
    try:
        return occupied_cells(map_at(recording, aligned(estimate.poses, recording.truth)))
    except ValueError:
        return None


def _centres(cells: np.ndarray | None) -> Array:
    return np.zeros((0, 2)) if cells is None else (cells + 0.5) * RESOLUTION


def _draw_walls(ax: Axes, cells: np.ndarray | None, truth: np.ndarray | None) -> None:
    """Walls as squares of a cell's side on paper, at least of what can be seen."""
    if cells is None:
        ax.text(0.5, 0.5, "map too large to draw", transform=ax.transAxes, **CENTRED)
        return
    layers = [(cells, BLACK)]
    if truth is not None:
        found = cells_found(cells, truth)
        layers = [(truth[~cells_found(truth, cells)], ORANGE), (cells[~found], BLUE), (cells[found], BLACK)]
    left, right, low, high = ax.axis()
    points = 72.0 * ax.get_position().width * ax.figure.bbox.width / ax.figure.dpi
    size = max(1.4 * points * RESOLUTION / (right - left), 0.8)
    style: dict[str, Any] = {"linestyle": "none", "marker": "s", "markersize": size, "markeredgewidth": 0}
    for walls, colour in layers:
        x, y = _centres(walls).T
        ax.plot(x, y, color=colour, rasterized=True, **style)
    x, y = _centres(cells).T
    outside = np.mean((x < left) | (x > right) | (y < low) | (y > high)) if len(cells) else 0.0
    if outside >= 0.005:
        note = f"{outside:.0%} of the walls lie outside"
        ax.text(0.02, 0.02, note, transform=ax.transAxes, fontsize=FONT["tick"])


def _confidence_panel(ax: Axes, scans: np.ndarray, values: Array, lost: np.ndarray, scale: str) -> None:
    drawable = np.isfinite(values) & ((values > 0.0) if scale == "log" else True)
    ax.set_yscale(scale)
    if scale == "log":
        ax.yaxis.set_major_locator(LogLocator(numticks=TICKS))
        ax.yaxis.set_major_formatter("{x:.0e}")  # plain text: mathematics take ten times as long to set
    ax.yaxis.set_minor_locator(NullLocator())
    alone = drawable & ~np.append(False, drawable[:-1]) & ~np.append(drawable[1:], False)
    shown = np.where(drawable, values, np.nan)
    ax.plot(scans, shown, color=BLACK, linewidth=0.5, marker=".", markersize=2.5, markevery=alone)
    if not np.any(drawable):
        ax.text(0.5, 0.5, "no step was matched", transform=ax.transAxes, **CENTRED)
    elif scale == "linear":
        ax.set_ylim(bottom=0.0)
    dots: dict[str, Any] = {"color": VERMILLION, "marker": "o", "markersize": 5, "linestyle": "none"}
    on_axis = ax.get_xaxis_transform()
    ax.plot(lost, np.zeros(len(lost)), transform=on_axis, clip_on=False, zorder=5, **dots)
    ax.grid(axis="y", color=GREY, linewidth=0.4, alpha=0.6)
