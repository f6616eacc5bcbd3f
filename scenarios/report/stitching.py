"""Figures of cutting and stitching, after the report's: pieces (A.2), steps one by one (A.3), one stitch with
its spectra (5.4, 5.5, 5.13) and its result (5.14). Each returns a matplotlib ``Figure``."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from scenarios.report.evidence import (
    REACH,
    RESOLUTION,
    Axis,
    Walls,
    axes,
    rotation_correlation,
    surface,
)
from scenarios.report.pieces import MERGING, before, partner, piece, pose_of
from scenarios.report.style import BLACK, BLUE, FONT, GREY, ORANGE, VERMILLION, WIDTH, settle, titled
from scenarios.report.tiles import Tile, in_both, pair, sheet
from slam import se2
from slam.se2 import Array
from stitch.alignment.config import AlignConfig
from stitch.alignment.translation import Correlation
from stitch.mapping.estimate import Estimate, LoopCandidate

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

ROOM = {"left": 0.04, "right": 0.99, "bottom": 0.05, "top": 0.94, "wspace": 0.22, "hspace": 0.42}
"""Around and between the panels of one stitch, as shares of the figure and of a panel."""


def submaps(estimate: Estimate) -> Figure:
    """Every submap in its own frame (report, figure A.2)."""
    return sheet(
        [
            Tile(f"{k}: {submap.start} to {submap.stop - 1}", ((submap.grid.occupied_points(), BLACK),))
            for k, submap in enumerate(estimate.submaps)
        ]
    )


def steps(estimate: Estimate, false: frozenset[int] = frozenset()) -> Figure:
    """Every accepted stitch with both pieces where it put them (report, figure A.3).

    ``false`` are the indices into the estimate's stitches whose titles are red.
    """
    return sheet(
        [
            step(estimate, tried, VERMILLION if k in false else BLACK)
            for k, tried in enumerate(estimate.stitches)
            if tried.accepted
        ]
    )


def step(estimate: Estimate, tried: LoopCandidate, colour: str) -> Tile:
    """A stitch on a tile: a blue, b orange, both black. Raises ``ValueError`` without an alignment."""
    T = pose_of(tried)
    if T is None:
        raise ValueError(f"stitch {tried.a}-{tried.b} of {estimate.method} has no alignment to draw")
    moved = se2.transform(T, piece(estimate, tried.b).points)
    a = f"0…{tried.b - 1}" if estimate.method in MERGING else f"{tried.a}"
    return pair(f"{a} ← {tried.b}", partner(estimate, tried).points, moved, colour)


def drawable(estimate: Estimate, tried: LoopCandidate) -> bool:
    """Whether a stitch has an alignment, and walls on both sides."""
    pieces = (partner(estimate, tried), piece(estimate, tried.b))
    return pose_of(tried) is not None and all(len(walls.points) > 0 for walls in pieces)


def one(estimate: Estimate, tried: LoopCandidate, config: AlignConfig) -> Figure:
    """A stitch: both maps before and after, Hough spectra, X and Y spectra, and the score around it.

    Raises ``ValueError`` without an alignment or walls to draw.
    """
    from matplotlib.figure import Figure

    a, b, T = partner(estimate, tried), piece(estimate, tried.b), pose_of(tried)
    if T is None or len(a.points) == 0 or len(b.points) == 0:
        raise ValueError(f"stitch {tried.a}-{tried.b} of {estimate.method} has no alignment to draw")
    found = surface(a, b, T, config)
    third = "after" if found is None or found.agreement.size == 0 else "surface"
    left = ["before", "after", third]
    figure = Figure(figsize=(WIDTH, 5.4))
    ax = figure.subplot_mosaic(
        [[*left, "spectra"], [*left, "turns"], ["X", "X shifts", "Y", "Y shifts"]],
        height_ratios=[1.0, 1.0, 1.1],
        gridspec_kw=ROOM,
    )
    for panel in ax.values():
        settle(panel)
    _pieces(ax["before"], a.points, se2.transform(before(estimate, tried), b.points), "before")
    _pieces(ax["after"], a.points, se2.transform(T, b.points), "after", agreement=True)
    if found is not None and third == "surface":
        _surface(ax["surface"], found, T, config)
    _rotation(ax["spectra"], ax["turns"], a, b, T)
    for name, axis in zip("XY", axes(a, b, T), strict=True):
        _profiles(ax[name], axis, name)
        _shifts(ax[f"{name} shifts"], axis, name)
    return figure


def _pieces(ax: Axes, a: Array, b: Array, title: str, agreement: bool = False) -> None:
    found = in_both(a, b) if agreement else np.zeros(len(b), dtype=bool)
    layers = [(a, BLUE, "a"), (b[~found], ORANGE, "b"), (b[found], BLACK, "both")]
    for points, colour, label in layers[: 3 if agreement else 2]:
        ax.scatter(
            points[:, 0], points[:, 1], s=2.0, color=colour, linewidths=0, label=label, rasterized=True
        )
    ax.set_aspect("equal", adjustable="datalim")
    titled(ax, title, "left")
    if agreement:
        ax.legend(
            fontsize=FONT["tick"], frameon=False, ncols=3, markerscale=4, loc="lower right", borderpad=0.0,
            bbox_to_anchor=(1.0, 1.0), handletextpad=0.1, columnspacing=0.8,
        )  # fmt: skip


def _rotation(above: Axes, below: Axes, a: Walls, b: Walls, T: Array) -> None:
    """Hough spectra and their correlation (report, figures 5.4 and 5.13)."""
    for walls, colour in ((a, BLUE), (b, ORANGE)):
        above.plot(np.arange(len(walls.spectrum)), walls.spectrum, color=colour, linewidth=0.9)
    titled(above, "Hough spectra [°]", "left")
    below.plot(rotation_correlation(a, b), color=BLACK, linewidth=0.9)
    turn = float(np.degrees(T[2]))
    below.axvline(turn % 180.0, color=VERMILLION, linestyle=":", linewidth=1.2)
    titled(below, f"correlation [°]: {turn:.1f}°", "left")
    for ax in (above, below):
        ax.set_xlim(0.0, 180.0)
        ax.set_ylim(bottom=0.0)
        ax.set_xticks(range(0, 181, 45))
        ax.grid(color=GREY, linewidth=0.4, alpha=0.6)


def _profiles(ax: Axes, axis: Axis, name: str) -> None:
    """X or Y spectra, b's where it was put (report, figure 5.5)."""
    for counts, first, colour in (
        (axis.a, axis.first_a, BLUE),
        (axis.b, axis.first_b + axis.shift, ORANGE),
    ):
        ax.plot(
            first + (np.arange(len(counts)) + 0.5) * RESOLUTION,
            counts,
            color=colour,
            linewidth=0.9,
        )
    titled(ax, f"{name} spectra [m]", "left")


def _shifts(ax: Axes, axis: Axis, name: str) -> None:
    x = axis.first_shift + np.arange(len(axis.correlation)) * RESOLUTION
    ax.plot(x, axis.correlation, color=BLACK, linewidth=0.9)
    ax.axvline(axis.shift, color=VERMILLION, linestyle=":", linewidth=1.2)
    titled(ax, f"{name} correlation: {axis.shift:.2f} m", "left")


def _surface(ax: Axes, found: Correlation, T: Array, config: AlignConfig) -> None:
    """Score of shifts around the answer: bright where walls lie on walls."""
    score = found.score(config.search.lenient_penalty)
    height, width = score.shape
    x, y = found.first - 0.5 * found.resolution
    extent = (x, x + width * found.resolution, y, y + height * found.resolution)
    ax.imshow(score, origin="lower", extent=extent, cmap="viridis", vmin=float(np.median(score)))
    ax.plot(T[0], T[1], marker="+", color="white", markersize=10, markeredgewidth=1.5)
    titled(ax, f"score within {REACH:.0f} m", "left")
