"""Maps whose poses are known, as one grid and as a picture of it."""

from __future__ import annotations

import io
import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from slam import se2
from slam.mapping.occupancy import MAX_CELLS, Grid, dilated
from slam.se2 import Array
from stitch.alignment.result import Alternative, Stitch

COLOURS = ("#0072B2", "#E69F00", "#009E73", "#CC79A7", "#56B4E9", "#D55E00")
"""Of the maps, in turn (Okabe & Ito 2008: told apart by the colour-blind)."""
OVERLAP_COLOUR = "#000000"
GRID_COLOUR = "#56B4E9"
OPEN, OPEN_TO_MANY = "#F4F4F4", "#DEDEDE"
PIXELS = 1000
"""Cells of the longer side at most: every cell is a pixel at least, so that no wall gets lost."""
LONGEST, LEAST, DPI = 9.0, (5.0, 1.0), 120
"""The longer side and the least width and height [inch]."""
BAR, LEGEND_ROW, PER_ROW = 0.4, 0.3, 3
"""Height of the scale bar's strip and of a row of the legend [inch], and the entries in a row."""


def canvas(grids: Sequence[Grid], poses: Sequence[Array], resolution: float) -> Grid:
    """An unknown grid with room for what is known of ``grids`` at ``poses``, each ``(3,)``.

    It shares the cell borders of the first of them. Raises ``ValueError`` when it would have more cells than
    `slam.mapping.occupancy.MAX_CELLS`.
    """
    corners = np.concatenate([se2.transform(T, _outline(grid)) for grid, T in zip(grids, poses, strict=True)])
    cells = (corners - grids[0].origin) / resolution
    first, last = np.floor(cells.min(axis=0) + 1e-6), np.ceil(cells.max(axis=0) - 1e-6)
    columns, rows = last - first
    if not rows * columns <= MAX_CELLS:
        raise ValueError(
            f"a merged map of {columns:.0f} x {rows:.0f} cells is too large, at most {MAX_CELLS:,} cells"
        )
    unknown = np.zeros((int(rows), int(columns)), dtype=bool)
    return Grid(unknown, unknown, grids[0].origin + first * resolution, resolution)


def _outline(grid: Grid) -> Array:
    """Corners ``(n, 2)`` m of the first and the last known cell of every row: all others lie between them."""
    known = grid.occupied | grid.free
    rows = np.flatnonzero(known.any(axis=1))
    first, last = known[rows].argmax(axis=1), known.shape[1] - known[rows, ::-1].argmax(axis=1)
    corners = [np.stack([x, y], -1) for x in (first, last) for y in (rows, rows + 1)]
    return grid.origin + np.concatenate(corners) * grid.resolution


def place(grid: Grid, T: Array, onto: Grid) -> Grid:
    """A grid moved by ``T (3,)`` onto the cells of another.

    Occupied cells are moved as points, dense enough to leave no holes; free space is looked up from the
    centre of each target cell.
    """
    from stitch.alignment.raster import look_up

    height, width = onto.occupied.shape
    points = se2.transform(T, _dense_points(grid, onto.resolution))
    column, row = np.floor((points - onto.origin) / onto.resolution).astype(np.int64).T
    occupied = np.zeros((height, width), dtype=bool)
    # a point on the border may round to either side of it
    occupied[np.clip(row, 0, height - 1), np.clip(column, 0, width - 1)] = True
    shifted = np.array([*(T[:2] - onto.origin), T[2]])
    free = look_up(
        grid.free, grid.origin, grid.resolution, shifted, np.zeros(2), (height, width), onto.resolution
    )
    return Grid(occupied, free & ~occupied, onto.origin, onto.resolution)


def _dense_points(grid: Grid, spacing: float) -> Array:
    """Points ``(n, 2)`` m over the occupied cells, at most ``spacing`` m apart."""
    split = int(np.ceil(grid.resolution / spacing - 1e-6))
    offsets = ((np.arange(split) + 0.5) / split - 0.5) * grid.resolution
    dx, dy = (part.ravel() for part in np.meshgrid(offsets, offsets))
    return (grid.occupied_points()[:, None] + np.stack([dx, dy], -1)).reshape(-1, 2)


def bent(grid: Grid, stitch: Stitch | Alternative) -> Grid:
    """A grid as its stitch enlarges and bends it, in the frame that ``stitch.T_a_b`` moves.

    Occupied cells are moved as points; free space is looked up from where each cell came from.
    """
    bend, T, scale = stitch.bend, stitch.T_a_b, stitch.scale
    resolution = scale * grid.resolution
    x_min, x_max, y_min, y_max = grid.extent
    reach = 0.0 if bend is None else bend.largest_displacement(T)
    first = np.floor((scale * np.array([x_min, y_min]) - reach) / resolution)
    columns, rows = (np.ceil((scale * np.array([x_max, y_max]) + reach) / resolution) - first).astype(int)
    origin = first * resolution
    occupied = np.zeros((rows, columns), dtype=bool)
    points = scale * _dense_points(grid, 0.6 * grid.resolution)
    placed = points if bend is None else se2.transform(se2.inverse(T), bend.apply(points))
    column, row = np.floor((placed - origin) / resolution).astype(np.int64).T
    occupied[np.clip(row, 0, rows - 1), np.clip(column, 0, columns - 1)] = True
    x, y = np.meshgrid(np.arange(columns), np.arange(rows))
    centres = origin + (np.stack([x.ravel(), y.ravel()], -1) + 0.5) * resolution
    back = centres if bend is None else bend.undo(se2.transform(T, centres), T)
    column, row = np.floor((back / scale - grid.origin) / grid.resolution).astype(np.int64).T
    inside = (column >= 0) & (row >= 0) & (column < grid.free.shape[1]) & (row < grid.free.shape[0])
    free = np.zeros(rows * columns, dtype=bool)
    free[inside] = grid.free[row[inside], column[inside]]
    return Grid(occupied, free.reshape(rows, columns) & ~occupied, origin, resolution)


def merge(layers: Sequence[Grid]) -> Grid:
    """Grids of one canvas as one: a cell is occupied where any of them is, and else free where any is.

    Where the maps contradict each other the wall stays: somebody may want to drive there.
    """
    occupied = np.any([layer.occupied for layer in layers], axis=0)
    free = np.any([layer.free for layer in layers], axis=0)
    return Grid(occupied, free & ~occupied, layers[0].origin, layers[0].resolution)


def draw(
    names: Sequence[str],
    grids: Sequence[Grid],
    poses: Sequence[Array],
    resolution: float,
    lines: Sequence[Array] = (),
) -> bytes:
    """PNG of ``grids`` at ``poses``, each ``(3,)``, in the frame of the first, with a legend and a scale bar.

    Walls are shared where another map has one within a cell (after the thesis's figure 5.14). ``lines``, each
    ``(n, 2)`` m, are drawn across it: a grid that is bent with a map.
    """
    x_min, x_max, y_min, y_max = canvas(grids, poses, resolution).extent
    onto = canvas(grids, poses, max(resolution, (x_max - x_min) / PIXELS, (y_max - y_min) / PIXELS))
    layers = [place(grid, T, onto) for grid, T in zip(grids, poses, strict=True)]
    return _png(_coloured(layers), onto, names, lines)


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


def _png(cells: np.ndarray, onto: Grid, names: Sequence[str], lines: Sequence[Array] = ()) -> bytes:
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
    for line in lines:
        ax.plot(line[:, 0], line[:, 1], color=GRID_COLOUR, linewidth=0.5, alpha=0.7)
    ax.set(xlim=onto.extent[:2], ylim=onto.extent[2:])
    ax.set_axis_off()
    _scale_bar(figure, inch / onto.resolution, (0.5 * wide, foot - 0.6 * BAR))
    legend = figure.legend(handles=patches, loc="lower center", ncols=PER_ROW, frameon=False)
    for text in legend.get_texts():
        text.set_parse_math(False)
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=DPI, facecolor="white")
    return buffer.getvalue()


def _scale_bar(figure: Any, per_metre: float, middle: tuple[float, float]) -> None:
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
