"""Stitches: what each was made of and what speaks for it (walls, Hough spectra, X and Y spectra, and how the
score falls off around it), and the figures of submaps and stitches, after the thesis: submaps (A.2), accepted
stitches one by one (A.3), one stitch with its spectra (5.4, 5.5, 5.13) and its result (5.14)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy.spatial import cKDTree

from scenarios.report.method_attributes import merges_in_sequence
from scenarios.report.style import FONT, WIDTH, box, fix_axes, set_title
from slam import se2
from slam.colours import BLACK, BLUE, GREY, ORANGE, VERMILLION
from slam.mapping.occupancy import Grid
from slam.se2 import Array
from stitch.alignment import hough
from stitch.alignment.config import AlignConfig
from stitch.alignment.hough import cross_correlation
from stitch.alignment.raster import rasterise
from stitch.alignment.result import Stitch
from stitch.alignment.translation import correlate, correlation_along, padded_shape, profile, spectra
from stitch.mapping.estimate import Estimate, LoopCandidate
from stitch.published.htms import DIRECTIONS, dominant_direction

RESOLUTION = 0.1
"""Side of the cells [m] that walls are counted in."""
SEARCH = AlignConfig().search
REACH = 2.0
"""Half the width [m] of the score surface."""
State = Literal["accepted", "false", "rejected", "refused"]
"""Of a candidate: in the map; in the map and untrue; rejected by the graph; refused by the alignment."""
LAYOUT = {"left": 0.04, "right": 0.99, "bottom": 0.05, "top": 0.94, "wspace": 0.22, "hspace": 0.42}
"""Around and between the panels of one stitch, as shares of the figure and of a panel."""
MAX_TILES, COLUMNS = 60, 8
"""Tiles on a sheet, and in a row."""
SAME_WALL = 0.15
"""Walls of two submaps nearer than this [m] are in both: one cell of 0.1 m, also across its corner."""
MAP_SHARE, TITLE_SHARE = 0.9, 0.16
"""Of a tile: share that the map fills, height of the line above it."""


@dataclass(frozen=True)
class Walls:
    """Wall points ``(n, 2)`` m of a map in its own frame, and its grid where it is one submap."""

    points: Array
    grid: Grid | None

    @cached_property
    def spectrum(self) -> Array:
        """Hough spectrum ``(180,)``, one bin a degree."""
        return hough.spectrum(hough.transform(self.points, DIRECTIONS, RESOLUTION, split=False))


Curve = tuple[float, Array]
"""Where the first of the values ``(n,)`` lies [m], and the values, `RESOLUTION` apart."""


@dataclass(frozen=True)
class AxisSpectra:
    """Spectra of both maps along one direction, their correlation, and the ``shift`` of b [m]."""

    a: Curve
    b: Curve
    correlation: Curve
    shift: float


@dataclass(frozen=True)
class AlignedPair:
    """A candidate of an estimate with its evidence: walls of ``a`` and ``b``, each in its own frame; where b
    was in the frame of a ``before``; and where the alignment, or the best candidate of a refusal, puts it
    (``T_a_b``, None where there is neither)."""

    a: Walls
    b: Walls
    before: Array
    T_a_b: Array | None

    @classmethod
    def of(cls, estimate: Estimate, candidate: LoopCandidate) -> AlignedPair:
        """The pair of a candidate; where methods merge in sequence a is all submaps before b."""
        result = candidate.result if isinstance(candidate.result, Stitch) else candidate.result.best
        merges = merges_in_sequence(estimate.method)
        return cls(
            merged_walls(estimate, candidate.b) if merges else _walls_of(estimate, candidate.a),
            _walls_of(estimate, candidate.b),
            _before(estimate, candidate),
            None if result is None else result.T_a_b,
        )

    @property
    def complete(self) -> bool:
        """Whether there is an alignment, and walls on both sides."""
        return self.T_a_b is not None and len(self.a.points) > 0 and len(self.b.points) > 0

    @property
    def alignment(self) -> Array:
        """``T_a_b`` where there is one."""
        assert self.T_a_b is not None
        return self.T_a_b

    def layers(self) -> list[tuple[Array, str, str]]:
        """`pair_layers` of both maps where the alignment puts them, in the frame of a."""
        return pair_layers(self.a.points, se2.transform(self.alignment, self.b.points))

    def rotation_correlation(self) -> Array:
        """Circular cross-correlation ``(180,)`` of the Hough spectra, largest 1; bin k is a turn of b by
        k°."""
        correlation = cross_correlation(self.a.spectrum, self.b.spectrum)
        return correlation / max(float(correlation.max()), np.finfo(float).tiny)

    def axis_spectra(self) -> tuple[AxisSpectra, AxisSpectra]:
        """X and Y spectra once both maps are turned to the walls of a and to each other (thesis, section
        3.5); ``shift`` is where the alignment puts b."""
        T_a_b, direction = self.alignment, dominant_direction(self.a.spectrum)
        turned_a = self.a.points @ se2.rotation(-direction).T
        turned_b = self.b.points @ se2.rotation(T_a_b[2] - direction).T
        shift = se2.rotation(-direction) @ T_a_b[:2]
        x, y = (_along_axis(turned_a[:, k], turned_b[:, k], float(shift[k])) for k in (0, 1))
        return x, y

    def score_surface(self) -> tuple[Array, Array] | None:
        """Score ``(h, w)`` of shifts of b within `REACH` of the alignment, `RESOLUTION` apart, and the first
        shift ``(2,)`` m; None for more than single submaps, and where there is nothing to shift."""
        a, b, T_a_b = self.a, self.b, self.alignment
        if a.grid is None or b.grid is None:
            return None
        still = rasterise(a.points, a.grid, np.zeros(3), RESOLUTION)
        moving = rasterise(b.points, b.grid, np.array([0.0, 0.0, T_a_b[2]]), RESOLUTION)
        shape = padded_shape(still, [moving])
        window = (T_a_b[:2] - REACH, T_a_b[:2] + REACH)
        shifts = correlate(spectra(still, shape), spectra(moving, shape), SEARCH.blur, window)
        return (shifts.score(SEARCH.lenient_penalty), shifts.first) if shifts.agreement.size else None


def state_of(candidate: LoopCandidate, false: bool) -> State:
    """What became of a candidate, which truth, where there is any, calls ``false``."""
    if not isinstance(candidate.result, Stitch):
        return "refused"
    if not candidate.accepted:
        return "rejected"
    return "false" if false else "accepted"


def merged_walls(estimate: Estimate, b: int) -> Walls:
    """The walls of all submaps before ``b`` where the method put them (before, where it refused them), in the
    frame of the first, thinned to cells."""
    parts = [estimate.submaps[0].grid.occupied_points()]
    for other in estimate.stitches:
        if other.b < b:
            T = other.result.T_a_b if isinstance(other.result, Stitch) else _before(estimate, other)
            parts.append(se2.transform(T, estimate.submaps[other.b].grid.occupied_points()))
    cells = np.unique(np.floor(np.concatenate(parts) / RESOLUTION).astype(np.int64), axis=0)
    return Walls((cells + 0.5) * RESOLUTION, None)


def _walls_of(estimate: Estimate, k: int) -> Walls:
    grid = estimate.submaps[k].grid
    return Walls(grid.occupied_points(), grid)


def _before(estimate: Estimate, candidate: LoopCandidate) -> Array:
    """Where b was in the frame of a when the submaps were drawn."""
    return se2.between(estimate.submaps[candidate.a].anchor, estimate.submaps[candidate.b].anchor)


def _along_axis(a: Array, b: Array, shift: float) -> AxisSpectra:
    counts_a, first_a = profile(a, RESOLUTION)
    counts_b, first_b = profile(b, RESOLUTION)
    shifts, correlation = correlation_along(a, b, RESOLUTION)
    in_a, in_b = (first_a * RESOLUTION, counts_a), (first_b * RESOLUTION, counts_b)
    return AxisSpectra(in_a, in_b, (float(shifts[0]), correlation), shift)


@dataclass(frozen=True)
class Tile:
    """A small map: points ``(n, 2)`` m by colour, what lies on top last; its title and the title's colour."""

    title: str
    layers: tuple[tuple[Array, str], ...]
    colour: str = BLACK


def draw_submaps(estimate: Estimate) -> Figure:
    """Every submap in its own frame (thesis, figure A.2)."""
    tiles = [
        Tile(f"{k}: {submap.start} to {submap.stop - 1}", ((submap.grid.occupied_points(), BLACK),))
        for k, submap in enumerate(estimate.submaps)
    ]
    return draw_sheet(tiles)


def draw_accepted_stitches(estimate: Estimate, false: frozenset[int] = frozenset()) -> Figure:
    """Every accepted stitch with both submaps where it put them (thesis, figure A.3). ``false`` are the
    indices into the estimate's stitches whose titles are red."""
    tiles = []
    for k, stitch in enumerate(estimate.stitches):
        if stitch.accepted:
            a = f"0…{stitch.b - 1}" if merges_in_sequence(estimate.method) else f"{stitch.a}"
            layers = tuple(layer[:2] for layer in AlignedPair.of(estimate, stitch).layers())
            tiles.append(Tile(f"{a} ← {stitch.b}", layers, VERMILLION if k in false else BLACK))
    return draw_sheet(tiles)


def draw_stitch(estimate: Estimate, stitch: LoopCandidate) -> Figure:
    """A stitch: both maps before and after, Hough spectra, X and Y spectra, and the score around it. Raises
    ``ValueError`` without an alignment or walls to draw."""
    pair = AlignedPair.of(estimate, stitch)
    if not pair.complete:
        raise ValueError(f"stitch {stitch.a}-{stitch.b} of {estimate.method} has no alignment to draw")
    surface = pair.score_surface()
    left = ["before", "after", "after" if surface is None else "surface"]
    figure = Figure(figsize=(WIDTH, 5.4))
    ax = figure.subplot_mosaic(
        [[*left, "spectra"], [*left, "turns"], ["X", "X shifts", "Y", "Y shifts"]],
        height_ratios=[1.0, 1.0, 1.1],
        gridspec_kw=LAYOUT,
    )
    for panel in ax.values():
        fix_axes(panel)
    moved = se2.transform(pair.before, pair.b.points)
    _draw_walls(ax["before"], [(pair.a.points, BLUE, "a"), (moved, ORANGE, "b")], "before")
    _draw_walls(ax["after"], pair.layers(), "after")
    ax["after"].legend(
        fontsize=FONT["tick"], frameon=False, ncols=3, markerscale=4, loc="lower right", borderpad=0.0,
        bbox_to_anchor=(1.0, 1.0), handletextpad=0.1, columnspacing=0.8,
    )  # fmt: skip
    if surface is not None:
        _draw_surface(ax["surface"], *surface, pair.alignment)
    _draw_rotation(ax["spectra"], ax["turns"], pair)
    for name, axis in zip("XY", pair.axis_spectra(), strict=True):
        _draw_axis(ax[name], ax[f"{name} shifts"], axis, name)
    return figure


def pair_layers(a: Array, b: Array) -> list[tuple[Array, str, str]]:
    """Walls ``(n, 2)`` and ``(m, 2)`` of two submaps in one frame: what a has, what only b has, and what of
    b both have, with colour and label."""
    both = np.zeros(len(b), dtype=bool)
    if len(a) and len(b):
        both = np.isfinite(cKDTree(a).query(b, distance_upper_bound=SAME_WALL)[0])
    return [(a, BLUE, "a"), (b[~both], ORANGE, "b"), (b[both], BLACK, "both")]


def _draw_walls(ax: Axes, layers: Sequence[tuple[Array, str, str]], title: str) -> None:
    for points, colour, label in layers:
        x, y = points.T
        ax.scatter(x, y, s=2.0, color=colour, linewidths=0, label=label, rasterized=True)
    ax.set_aspect("equal", adjustable="datalim")
    set_title(ax, title, "left")


def _draw_rotation(above: Axes, below: Axes, pair: AlignedPair) -> None:
    """Hough spectra and their correlation (thesis, figures 5.4 and 5.13)."""
    for walls, colour in ((pair.a, BLUE), (pair.b, ORANGE)):
        above.plot(np.arange(len(walls.spectrum)), walls.spectrum, color=colour, linewidth=0.9)
    set_title(above, "Hough spectra [°]", "left")
    turn = float(np.degrees(pair.alignment[2]))
    _draw_correlation(below, np.arange(180.0), pair.rotation_correlation(), turn % 180.0)
    set_title(below, f"correlation [°]: {turn:.1f}°", "left")
    for ax in (above, below):
        ax.set_xlim(0.0, 180.0)
        ax.set_ylim(bottom=0.0)
        ax.set_xticks(range(0, 181, 45))
        ax.grid(color=GREY, linewidth=0.4, alpha=0.6)


def _draw_axis(left: Axes, right: Axes, axis: AxisSpectra, name: str) -> None:
    """X or Y spectra, b's where it was put, and their correlation (thesis, figure 5.5)."""
    for (first, counts), shift, colour in ((axis.a, 0.0, BLUE), (axis.b, axis.shift, ORANGE)):
        x = first + shift + (np.arange(len(counts)) + 0.5) * RESOLUTION
        left.plot(x, counts, color=colour, linewidth=0.9)
    set_title(left, f"{name} spectra [m]", "left")
    first, correlation = axis.correlation
    shifts = first + np.arange(len(correlation)) * RESOLUTION
    _draw_correlation(right, shifts, correlation, axis.shift)
    set_title(right, f"{name} correlation: {axis.shift:.2f} m", "left")


def _draw_correlation(ax: Axes, shifts: Array, values: Array, chosen: float) -> None:
    ax.plot(shifts, values, color=BLACK, linewidth=0.9)
    ax.axvline(chosen, color=VERMILLION, linestyle=":", linewidth=1.2)


def _draw_surface(ax: Axes, score: Array, first: Array, T: Array) -> None:
    """Score of shifts around the answer: bright where walls lie on walls."""
    height, width = score.shape
    x, y = first - 0.5 * RESOLUTION
    extent = (x, x + width * RESOLUTION, y, y + height * RESOLUTION)
    ax.imshow(score, origin="lower", extent=extent, cmap="viridis", vmin=float(np.median(score)))
    ax.plot(T[0], T[1], marker="+", color="white", markersize=10, markeredgewidth=1.5)
    set_title(ax, f"score within {REACH:.0f} m", "left")


def draw_sheet(tiles: Sequence[Tile]) -> Figure:
    """The tiles in rows, the first `MAX_TILES` of them; each title with the larger side of what it shows."""
    shown = tiles[:MAX_TILES]
    columns = min(COLUMNS, max(len(shown), 3))
    rows = math.ceil(len(shown) / columns)
    side = WIDTH / columns
    height = rows * side * (1.0 + TITLE_SHARE) + (0.35 if len(tiles) > MAX_TILES else 0.05)
    figure = Figure(figsize=(WIDTH, height))
    ax = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    ax.set(xlim=(0.0, columns), ylim=(-height / side, 0.0))
    ax.set_axis_off()
    by_colour: dict[str, list[Array]] = {}
    for i, tile in enumerate(shown):
        corner = np.array([i % columns, -(i // columns) * (1.0 + TITLE_SHARE)])
        middle, sides = box(np.concatenate([points for points, _ in tile.layers]))
        size = max(float(sides.max()), 1.0)
        for points, colour in tile.layers:
            placed = corner + [0.5, -TITLE_SHARE - 0.5] + MAP_SHARE * (points - middle) / size
            by_colour.setdefault(colour, []).append(placed)
        ax.text(
            corner[0] + 0.5, corner[1] - 0.6 * TITLE_SHARE, f"{tile.title}, {size:.0f} m",
            ha="center", va="center", fontsize=FONT["tick"], color=tile.colour, parse_math=False,
        )  # fmt: skip
    for colour in (BLUE, ORANGE, BLACK):
        if colour in by_colour:
            x, y = np.concatenate(by_colour[colour]).T
            ax.scatter(x, y, s=1.6, color=colour, linewidths=0, rasterized=True)
    if len(tiles) > MAX_TILES:
        left_out = f"and {len(tiles) - MAX_TILES} more"
        ax.text(columns / 2, 0.1 - height / side, left_out, fontsize=FONT["tick"], ha="center")
    return figure
