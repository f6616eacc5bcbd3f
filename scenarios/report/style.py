"""Colours and panels of the figures: readable for the colour-blind, in print, and 1100 pixels wide."""

from __future__ import annotations

import io
import math
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Okabe & Ito 2008
BLACK, ORANGE, SKY, GREEN = "#000000", "#E69F00", "#56B4E9", "#009E73"
BLUE, VERMILLION, PURPLE, GREY = "#0072B2", "#D55E00", "#CC79A7", "#B0B0B0"

WIDTH = 11.0
"""Width of a figure [inch]: 1100 pixels at 100 dpi."""
DPI = 150
FONT = {"title": 10, "label": 9, "tick": 8}


def panels(count: int, aspect: float) -> tuple[Figure, list[Axes]]:
    """A figure of ``count`` panels whose height is ``aspect`` times their width, and their axes."""
    from matplotlib.figure import Figure

    rows = max(1, round(math.sqrt(count / (1.4 * aspect))))
    columns = math.ceil(count / rows)
    width = WIDTH if columns > 1 else min(WIDTH, 8.0 / aspect + 1.0)
    height = (
        rows * ((width / columns - 0.45) * aspect + 0.55) + 0.4
    )  # beside the panels: labels, titles, legend
    figure = Figure(figsize=(width, height), layout="constrained")
    axes = [figure.add_subplot(rows, columns, i + 1) for i in range(count)]
    for i, ax in enumerate(axes):
        ax.set_aspect("equal")
        ax.tick_params(labelsize=FONT["tick"])
        if i + columns >= count:
            ax.set_xlabel("x [m]", fontsize=FONT["label"])
        if i % columns == 0:
            ax.set_ylabel("y [m]", fontsize=FONT["label"])
    return figure, axes


def png(figure: Figure, dpi: int = DPI) -> bytes:
    """The figure as a PNG file."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=dpi, facecolor="white")
    return buffer.getvalue()
