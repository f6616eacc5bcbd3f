"""Colours and panels of the figures: readable for the colour-blind, in print, and 1100 pixels wide."""

from __future__ import annotations

import io
import math
from typing import TYPE_CHECKING, Literal

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Okabe & Ito 2008
BLACK, ORANGE, SKY = "#000000", "#E69F00", "#56B4E9"
BLUE, VERMILLION, GREY = "#0072B2", "#D55E00", "#B0B0B0"

WIDTH = 11.0
"""Width of a figure [inch]: 1100 pixels at 100 dpi."""
DPI, PDF_DPI = 120, 150
"""Of pictures, and of the clouds of dots in a PDF, the rest of which is lines."""
FONT = {"title": 10, "label": 9, "tick": 8}


LEFT, RIGHT, BOTTOM, TOP = 0.65, 0.1, 0.75, 0.45
"""Room around the panels [inch]; the legend is at the bottom."""
BETWEEN_COLUMNS, BETWEEN_ROWS = 0.45, 0.7
TICKS = 4
BELOW, BESIDE = 0.25, 0.45
"""From a panel to the names of its axes [inch]."""


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


def titled(ax: Axes, words: str, loc: Literal["left", "center"] = "center") -> None:
    """A title at a fixed place: to find one, matplotlib would measure every label of the panel."""
    ax.set_title(words, fontsize=FONT["title"], loc=loc, y=1.0, parse_math=False)


def settle(ax: Axes) -> None:
    """About `TICKS` round numbers on either axis, as nine do not fit a small panel; names of the axes at a
    fixed distance. What matplotlib need not look for it draws in half the time."""
    from matplotlib.transforms import ScaledTranslation

    ax.locator_params(nbins=TICKS)
    ax.tick_params(labelsize=FONT["tick"])
    assert ax.figure is not None
    inches = ax.figure.dpi_scale_trans
    ax.xaxis.set_label_coords(0.5, 0.0, ax.transAxes + ScaledTranslation(0.0, -BELOW, inches))
    ax.yaxis.set_label_coords(0.0, 0.5, ax.transAxes + ScaledTranslation(-BESIDE, 0.0, inches))


def grid(
    count: int, columns: int, width: float, height: float, across: float, down: float, beside: float = 0.0
) -> tuple[Figure, list[Axes]]:
    """A figure of ``count`` panels of ``width`` x ``height``, ``across`` and ``down`` apart [inch], with
    room for more ``beside`` them, on the right."""
    from matplotlib.figure import Figure

    rows = math.ceil(count / columns)
    total = columns * width + (columns - 1) * across + LEFT + RIGHT + beside
    tall = rows * height + (rows - 1) * down + BOTTOM + TOP
    figure = Figure(figsize=(total, tall))
    places = figure.add_gridspec(
        rows,
        columns,
        left=LEFT / total,
        right=1.0 - (RIGHT + beside) / total,
        bottom=BOTTOM / tall,
        top=1.0 - TOP / tall,
        wspace=across / width,
        hspace=down / height,
    )
    axes = [figure.add_subplot(places[i // columns, i % columns]) for i in range(count)]
    for ax in axes:
        settle(ax)
    return figure, axes


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
