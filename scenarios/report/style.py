"""Sizes, panels and file formats of the figures: readable on a screen and in print, 11 inches wide."""

from __future__ import annotations

import io
import math
from collections.abc import Sequence
from typing import Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.transforms import ScaledTranslation

from slam.se2 import Array

WIDTH = 11.0
"""Width of a figure [inch]."""
DPI, PDF_DPI = 120, 150
"""Resolution of a PNG, and of the point clouds in a PDF, the rest of which is lines."""
FONT = {"title": 10, "label": 9, "tick": 8}
LEFT, RIGHT, BOTTOM, TOP = 0.65, 0.1, 0.75, 0.45
"""Room around the panels [inch]; the legend is at the bottom."""
BETWEEN_COLUMNS, BETWEEN_ROWS = 0.45, 0.7
TICKS = 4
LABEL_BELOW, LABEL_BESIDE = 0.25, 0.45
"""Distance from a panel to the labels of its axes [inch]."""


def panels(count: int, aspect: float) -> tuple[Figure, list[Axes]]:
    """A figure of ``count`` panels whose height is ``aspect`` times their width, and their axes."""
    rows = max(1, round(math.sqrt(count / (1.4 * aspect))))
    columns = math.ceil(count / rows)
    room = WIDTH - LEFT - RIGHT - (columns - 1) * BETWEEN_COLUMNS
    width = min(room / columns, 8.0 / aspect)
    figure, axes = grid(count, columns, width, width * aspect, BETWEEN_COLUMNS, BETWEEN_ROWS)
    for i, ax in enumerate(axes):
        ax.set_aspect("equal")
        if i + columns >= count:
            ax.set_xlabel("x [m]", fontsize=FONT["label"])
        if i % columns == 0:
            ax.set_ylabel("y [m]", fontsize=FONT["label"])
    return figure, axes


def set_title(ax: Axes, text: str, loc: Literal["left", "center"] = "center") -> None:
    """A title at a fixed place: to find one, matplotlib would measure every label of the panel."""
    ax.set_title(text, fontsize=FONT["title"], loc=loc, y=1.0, parse_math=False)


def fix_axes(ax: Axes) -> None:
    """About `TICKS` round numbers on either axis, as nine do not fit a small panel; labels of the axes at a
    fixed distance, which halves the time that matplotlib takes."""
    ax.locator_params(nbins=TICKS)
    ax.tick_params(labelsize=FONT["tick"])
    assert ax.figure is not None
    inches = ax.figure.dpi_scale_trans
    ax.xaxis.set_label_coords(0.5, 0.0, ax.transAxes + ScaledTranslation(0.0, -LABEL_BELOW, inches))
    ax.yaxis.set_label_coords(0.0, 0.5, ax.transAxes + ScaledTranslation(-LABEL_BESIDE, 0.0, inches))


def grid(
    count: int, columns: int, width: float, height: float, across: float, down: float, beside: float = 0.0
) -> tuple[Figure, list[Axes]]:
    """A figure of ``count`` panels of ``width`` x ``height``, ``across`` and ``down`` apart [inch], with
    room for more ``beside`` them, on the right."""
    rows = math.ceil(count / columns)
    total = columns * width + (columns - 1) * across + LEFT + RIGHT + beside
    tall = rows * height + (rows - 1) * down + BOTTOM + TOP
    figure = Figure(figsize=(total, tall))
    places = figure.add_gridspec(
        rows, columns, wspace=across / width, hspace=down / height,
        left=LEFT / total, right=1.0 - (RIGHT + beside) / total, bottom=BOTTOM / tall, top=1.0 - TOP / tall,
    )  # fmt: skip
    axes = [figure.add_subplot(places[i // columns, i % columns]) for i in range(count)]
    for ax in axes:
        fix_axes(ax)
    return figure, axes


def box(points: Array) -> tuple[Array, Array]:
    """Centre and size ``(2,)`` m of the box around points ``(n, 2)``, zero around none."""
    low, high = (points.min(axis=0), points.max(axis=0)) if len(points) else (np.zeros(2), np.zeros(2))
    return (low + high) / 2.0, high - low


def add_legend(figure: Figure, entries: Sequence[tuple[str, str]]) -> None:
    """What each colour means, under the figure: entries (words, colour)."""
    handles = [
        Line2D([], [], color=colour, marker="s", linestyle="none", markersize=7, label=label)
        for label, colour in entries
    ]
    figure.legend(handles=handles, loc="lower center", ncols=len(handles), fontsize=9, frameon=False)


def png(figure: Figure, dpi: int = DPI) -> bytes:
    """The figure as a PNG file."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=dpi, facecolor="white", pil_kwargs={"compress_level": 1})
    return buffer.getvalue()


def pdf(figure: Figure) -> bytes:
    """The figure as a PDF file, the same bytes at any time of day."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="pdf", dpi=PDF_DPI, facecolor="white", metadata={"CreationDate": None})
    return buffer.getvalue()
