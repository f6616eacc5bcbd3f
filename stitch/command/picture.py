"""Merged maps as a picture: each map's walls in a colour of their own, shared walls in black."""

from __future__ import annotations

import io
import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from slam.mapping.occupancy import Grid
from slam.se2 import Array
from stitch.alignment.raster import dilated
from stitch.command.merge import canvas, place

if TYPE_CHECKING:
    from matplotlib.figure import Figure

COLOURS = ("#0072B2", "#E69F00", "#009E73", "#CC79A7", "#56B4E9", "#D55E00")
"""Of the maps, in turn (Okabe & Ito 2008: told apart by the colour-blind)."""
OVERLAP_COLOUR = "#000000"
OPEN, OPEN_TO_MANY = "#F4F4F4", "#DEDEDE"
PIXELS = 1000
"""Cells of the longer side at most: every cell is a pixel at least, so that no wall gets lost."""
LONGEST, LEAST, DPI = 9.0, (5.0, 1.0), 120
"""The longer side and the least width and height [inch]."""
BAR, LEGEND_ROW, PER_ROW = 0.4, 0.3, 3
"""Height of the scale bar's strip and of a row of the legend [inch], and the entries in a row."""


def draw(names: Sequence[str], grids: Sequence[Grid], poses: Sequence[Array], resolution: float) -> bytes:
    """PNG of ``grids`` at ``poses``, each ``(3,)``, in the frame of the first, with a legend and a scale bar.

    Walls are shared where another map has one within a cell (after the thesis's figure 5.14).
    """
    x_min, x_max, y_min, y_max = canvas(grids, poses, resolution).extent
    onto = canvas(grids, poses, max(resolution, (x_max - x_min) / PIXELS, (y_max - y_min) / PIXELS))
    return _png(_coloured([place(grid, T, onto) for grid, T in zip(grids, poses, strict=True)]), onto, names)


def _coloured(layers: Sequence[Grid]) -> np.ndarray:
    """Colours ``(H, W, 3)`` of the cells, 0 to 1."""
    from matplotlib.colors import to_rgb

    seen_by = np.sum([layer.free for layer in layers], axis=0)
    cells = np.ones((*seen_by.shape, 3), dtype=np.float32)
    cells[seen_by == 1], cells[seen_by > 1] = to_rgb(OPEN), to_rgb(OPEN_TO_MANY)
    near = [dilated(layer.occupied) for layer in layers]
    count = np.sum(near, axis=0)
    for k, layer in enumerate(layers):
        cells[layer.occupied] = to_rgb(COLOURS[k % len(COLOURS)])
    for layer, own in zip(layers, near, strict=True):
        cells[layer.occupied & (count - own > 0)] = to_rgb(OVERLAP_COLOUR)
    return cells


def _png(cells: np.ndarray, onto: Grid, names: Sequence[str]) -> bytes:
    from matplotlib.figure import Figure
    from matplotlib.patches import Patch

    height, width = onto.occupied.shape
    inch = LONGEST / max(height, width)
    wide, tall = max(width * inch, LEAST[0]), max(height * inch, LEAST[1])
    shared = "walls in both" if len(names) == 2 else "walls in several"
    colours = [COLOURS[k % len(COLOURS)] for k in range(len(names))]
    patches = [
        Patch(color=c, label=name)
        for c, name in zip([*colours, OVERLAP_COLOUR], [*names, shared], strict=True)
    ]
    foot = BAR + LEGEND_ROW * math.ceil(len(patches) / PER_ROW)
    figure = Figure(figsize=(wide, tall + foot))
    ax = figure.add_axes((0.0, foot / (tall + foot), 1.0, tall / (tall + foot)))
    ax.imshow(cells, origin="lower", extent=onto.extent, interpolation="nearest", aspect="equal")
    ax.set_axis_off()
    _scale_bar(figure, inch / onto.resolution, (0.5 * wide, foot - 0.6 * BAR))
    legend = figure.legend(handles=patches, loc="lower center", ncols=PER_ROW, frameon=False)
    for text in legend.get_texts():
        text.set_parse_math(False)
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=DPI, facecolor="white")
    return buffer.getvalue()


def _scale_bar(figure: Figure, per_metre: float, middle: tuple[float, float]) -> None:
    """A bar of a round length, about a fifth of the picture; ``per_metre`` and ``middle`` in inches."""
    from matplotlib.lines import Line2D

    wanted = 0.2 * figure.get_figwidth() / per_metre
    power = 10.0 ** math.floor(math.log10(wanted))
    length = power * max(step for step in (1.0, 2.0, 5.0) if step * power <= wanted)
    half = 0.5 * length * per_metre
    x, y = middle
    inches = figure.dpi_scale_trans
    figure.add_artist(
        Line2D(
            [x - half, x + half], [y, y], color=OVERLAP_COLOUR, linewidth=2.0, marker="|", transform=inches
        )
    )
    figure.text(x + half + 0.1, y, f"{length:g} m", va="center", fontsize=9, transform=inches)
