"""The worked examples of the thesis' third chapter (Formsma 2012), drawn from shapes of our own with known
answers."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from scenarios.report.style import FONT, WIDTH, png
from slam import se2
from slam.colours import BLACK, BLUE, GREY, VERMILLION
from slam.mapping.occupancy import Grid
from slam.mapping.submap import Submap
from slam.scan import Scan
from slam.se2 import Array
from stitch.alignment import hough
from stitch.alignment.config import AlignConfig
from stitch.alignment.hough import cross_correlation
from stitch.alignment.result import Alternative
from stitch.alignment.translation import correlation_along, profile
from stitch.published.htms import DIRECTIONS, dominant_direction, four_hypotheses
from stitch.published.pair import Pair

PIXEL = 0.05
"""Side of a drawn cell [m]."""
T_MAP_CUTOUT = np.array([9.5, 3.5, np.radians(79.0)])
"""Where the cut-out lies in the map of rooms."""
CUTOUT = 3.6
"""Radius of the cut-out [m]: round, so that its edge has no direction."""
CONFIG = AlignConfig(method="htms", resolution=PIXEL)


def run(out: Path) -> Path:
    """Write the pictures, one PNG for each of `PICTURES`, into the folder ``out`` and return it."""
    out.mkdir(parents=True, exist_ok=True)
    for name, draw in PICTURES.items():
        (out / f"{name}.png").write_bytes(png(draw()))
    return out


def lines() -> Array:
    """Two lines, segments ``(2, 4)`` m: normals at 0° and 45°, 1.5 m and 0.5 m from the origin."""
    normal = np.array([1.0, 1.0]) / np.sqrt(2.0)
    along = np.array([-normal[1], normal[0]])
    slanted = [*(0.5 * normal - 2.0 * along), *(0.5 * normal + 2.0 * along)]
    return np.array([[1.5, -1.8, 1.5, 1.8], slanted])


def rooms() -> Array:
    """A floor of 12 x 8 m in segments ``(S, 4)`` m: rooms of different sizes with doors, walls at 0° and
    90°."""
    walls = [
        *_outline([(0.0, 0.0), (12.0, 0.0), (12.0, 8.0), (0.0, 8.0)]),
        (0.0, 4.6, 1.4, 4.6), (2.3, 4.6, 6.8, 4.6), (7.7, 4.6, 12.0, 4.6),
        (3.4, 0.0, 3.4, 2.6), (3.4, 3.5, 3.4, 4.6),
        (8.2, 0.0, 8.2, 0.7), (8.2, 1.6, 8.2, 4.6),
        (5.0, 4.6, 5.0, 6.9),
        (9.7, 5.7, 9.7, 8.0),
        (8.2, 2.9, 10.4, 2.9),
    ]  # fmt: skip
    furniture = [
        _outline([(5.2, 1.0), (6.4, 1.0), (6.4, 1.7), (5.2, 1.7)]),
        _outline([(0.6, 6.2), (1.5, 6.2), (1.5, 7.3), (0.6, 7.3)]),
        _outline([(10.9, 0.5), (11.5, 0.5), (11.5, 1.9), (10.9, 1.9)]),
    ]
    return np.array(walls + [side for piece in furniture for side in piece])


def hexagons() -> Array:
    """A round beehive of 19 chambers with sides of 1 m, segments ``(S, 4)`` m: normals at 0°, 60°, 120°."""
    corners = np.stack([np.sin(np.arange(6) * np.pi / 3), np.cos(np.arange(6) * np.pi / 3)], -1)
    walls: dict[tuple[float, float], tuple[float, float, float, float]] = {}
    for q in range(-2, 3):
        for r in range(max(-2, -2 - q), min(2, 2 - q) + 1):
            centre = np.array([np.sqrt(3.0) * (q + 0.5 * r), 1.5 * r])
            for side in _outline([(x, y) for x, y in centre + corners]):
                middle = (round(side[0] + side[2], 6), round(side[1] + side[3], 6))
                walls[middle] = side  # neighbours share a wall
    return np.array(list(walls.values()))


def _outline(corners: list[tuple[float, float]]) -> list[tuple[float, float, float, float]]:
    return [(*start, *end) for start, end in pairwise([*corners, corners[0]])]


def points_on(segments: Array) -> Array:
    """Points ``(n, 2)`` m on segments, closer than a pixel."""
    parts = []
    for segment in segments:
        count = int(np.ceil(np.hypot(*(segment[2:] - segment[:2])) / (0.5 * PIXEL))) + 1
        parts.append(segment[:2] + np.linspace(0.0, 1.0, count)[:, None] * (segment[2:] - segment[:2]))
    return np.concatenate(parts)


def rasterise_points(points: Array) -> Submap:
    """Points ``(n, 2)`` m as a submap of pixels; what is not a wall is free."""
    first = np.floor(points.min(axis=0) / PIXEL)
    column, row = (np.floor(points / PIXEL) - first).astype(int).T
    occupied = np.zeros((row.max() + 1, column.max() + 1), dtype=bool)
    occupied[row, column] = True
    grid = Grid(occupied, ~occupied, first * PIXEL, PIXEL)
    centres = grid.occupied_points()
    unknown = np.full_like(centres, np.nan)
    n = len(centres)
    covariance = np.tile(PIXEL**2 / 12.0 * np.eye(2), (n, 1, 1))
    scan = Scan(centres, unknown, unknown, covariance, np.full(n, np.nan), np.arange(n))
    return Submap(0, 1, np.zeros(3), scan, grid)


def rotate(points: Array, yaw: float) -> Array:
    """Points ``(n, 2)`` rotated by ``yaw`` rad about the origin."""
    return points @ se2.rotation(yaw).T


def map_and_cutout() -> tuple[Submap, Submap]:
    """The map of rooms and a round piece of it in a frame of its own, which lies at `T_MAP_CUTOUT`."""
    walls = points_on(rooms())
    piece = se2.transform(se2.inverse(T_MAP_CUTOUT), walls)
    return rasterise_points(walls), rasterise_points(piece[np.hypot(piece[:, 0], piece[:, 1]) <= CUTOUT])


def example() -> Pair:
    """The map of rooms and its cut-out (`map_and_cutout`), ready to be stitched."""
    return Pair(*map_and_cutout(), CONFIG)


def transform(points: Array) -> hough.Hough:
    """The thesis' Hough transform of points ``(n, 2)`` m, once drawn on a grid."""
    walls = rasterise_points(points).grid.occupied_points()
    return hough.transform(walls, DIRECTIONS, CONFIG.resolution, split=False)


def distance_from_truth(hypothesis: Alternative) -> tuple[float, float]:
    """How far a pose of the cut-out is from the true one: m, degrees."""
    error = se2.between(T_MAP_CUTOUT, hypothesis.T_a_b)
    return float(np.hypot(error[0], error[1])), float(np.degrees(abs(error[2])))


def _lines() -> Figure:
    """Figure 3.1: two lines and their Hough transform."""
    points = points_on(lines())
    figure, (left, right) = _panels(1, 2, 4.0)
    _map(left, points, "two lines")
    _transform(right, points, "their Hough transform: a line is a point, 0° is 180°")
    return figure


def _rotation() -> Figure:
    """Figure 3.4: lines, the same turned by 90°, and the cross-correlation of their spectra."""
    points = points_on(lines())
    spectrum, of_turned = (_spectrum(p) for p in (points, rotate(points, np.pi / 2)))
    figure, axes = _panels(3, 1, 6.0)
    _curve(axes[0], spectrum, "Hough spectrum of the lines")
    _curve(axes[1], of_turned, "of the lines turned by 90°")
    correlation = cross_correlation(of_turned, spectrum)
    _curve(axes[2], correlation, "cross-correlation: how far the lines were turned", x="angle [°]")
    return figure


def _profiles() -> Figure:
    """Figures 3.5 and 3.6: X and Y spectra of a map along its walls, and of the same map turned by 20°."""
    points = rasterise_points(points_on(rooms())).grid.occupied_points()
    figure = _figure(5.0)
    parts = figure.subfigures(1, 2, squeeze=False).ravel()
    for part, (yaw, title) in zip(parts, ((0.0, "along its walls"), (20.0, "turned by 20°")), strict=True):
        axes = part.subplots(2, 2, width_ratios=[1, 3], height_ratios=[3, 1])
        turned = rotate(points, np.radians(yaw))
        _map(axes[0, 1], turned, title)
        (x, along_x), (y, along_y) = (_profile(turned[:, axis]) for axis in (0, 1))
        axes[0, 0].plot(along_y, y, color=BLUE, linewidth=0.9)
        _label(axes[0, 0], x="Y spectrum [cells]", y="y [m]")
        axes[1, 1].plot(x, along_x, color=BLUE, linewidth=0.9)
        _label(axes[1, 1], x="x [m]", y="X spectrum")
        axes[1, 0].remove()
    return figure


def _cutout() -> Figure:
    """Figures 3.7 and 3.8: the map and the cut-out, their spectra and the cross-correlation."""
    maps = example()
    figure = _figure(7.0)
    above, below = figure.subfigures(2, 1, squeeze=False, height_ratios=[1.1, 1.0]).ravel()
    left, right = above.subplots(1, 2)
    _map(left, maps.walls_a, "the map")
    _map(right, maps.walls_b, "a cut-out in its own frame", VERMILLION)
    spectrum_a, spectrum_b = maps.spectra(DIRECTIONS, split=False)
    axes = below.subplots(1, 3)
    correlation = cross_correlation(spectrum_a, spectrum_b)
    _curve(axes[0], spectrum_a, "spectrum of the map", x="angle [°]")
    _curve(axes[1], spectrum_b, "of the cut-out", VERMILLION, "angle [°]")
    _curve(axes[2], correlation, "cross-correlation", BLACK, "angle [°]")
    axes[2].set_ylim(0.0, 1.15 * correlation.max())
    for name, hypothesis in zip(("θ₁", "θ₂"), four_hypotheses(maps)[::2], strict=True):
        degrees = float(np.degrees(hypothesis.T_a_b[2])) % 180.0
        height = correlation[round(degrees * DIRECTIONS / 180.0)]
        axes[2].annotate(
            f"{name} = {degrees:.0f}°", (degrees, height), (0, 4), textcoords="offset points",
            ha="right" if degrees > 150.0 else "center",
            fontsize=FONT["tick"], color=VERMILLION,
        )  # fmt: skip
    return figure


def _translation() -> Figure:
    """Figures 3.9 and 3.10: map and cut-out turned by the right hypothesis, X and Y spectra, correlations."""
    maps = example()
    right = min(four_hypotheses(maps), key=lambda hypothesis: distance_from_truth(hypothesis)[0])
    direction = dominant_direction(maps.spectra(DIRECTIONS, split=False)[0])
    turned_a = rotate(maps.walls_a, -direction)
    turned_b = rotate(maps.walls_b, float(right.T_a_b[2]) - direction)
    figure = _figure(8.5)
    above, below = figure.subfigures(2, 1, squeeze=False, height_ratios=[1.0, 1.4]).ravel()
    axes = above.subplots(1, 2)
    φ, θ = np.degrees(direction), np.degrees(right.T_a_b[2])
    _map(axes[0], turned_a, f"the map turned by -φ = {-φ:.0f}°")
    _map(axes[1], turned_b, f"the cut-out turned by θ - φ = {θ - φ:.0f}°", VERMILLION)
    grid = below.subplots(3, 2)
    for axis, name in enumerate("XY"):
        for row, (points, colour) in enumerate(((turned_a, BLUE), (turned_b, VERMILLION))):
            grid[row, axis].plot(*_profile(points[:, axis]), color=colour, linewidth=0.9)
        shifts, correlation = correlation_along(turned_a[:, axis], turned_b[:, axis], CONFIG.resolution)
        best = shifts[np.argmax(correlation)]
        grid[2, axis].plot(shifts, correlation, color=BLACK, linewidth=0.9)
        grid[2, axis].axvline(best, color=VERMILLION, linestyle=":", linewidth=1.0)
        _label(grid[0, axis], f"{name} spectra")
        _label(grid[1, axis])
        _label(grid[2, axis], f"their correlation: {best:.2f} m", "shift of the cut-out [m]")
    return figure


def _hypotheses() -> Figure:
    """Figure 3.11: the four hypotheses; one is right."""
    maps = example()
    figure, axes = _panels(2, 2, 8.0)
    names = ("θ₁", "θ₁ + 180°", "θ₂", "θ₂ + 180°")
    for ax, name, hypothesis in zip(axes, names, four_hypotheses(maps), strict=True):
        x, y, yaw = hypothesis.T_a_b
        metres, degrees = distance_from_truth(hypothesis)
        verdict = "right" if metres < 0.1 and degrees < 1.0 else f"{metres:.1f} m and {degrees:.0f}° off"
        _map(ax, maps.walls_a, f"{name} = {np.degrees(yaw):.0f}°, t = ({x:.2f}, {y:.2f}) m: {verdict}")
        moved = se2.transform(hypothesis.T_a_b, maps.walls_b)
        ax.scatter(moved[:, 0], moved[:, 1], s=2.5, color=VERMILLION, linewidths=0)
    return figure


def _with_spectrum(points: Array, title: str) -> Figure:
    figure, axes = _panels(1, 3, 3.6)
    _map(axes[0], points, title)
    _transform(axes[1], points, "Hough transform")
    _curve(axes[2], _spectrum(points), "Hough spectrum", x="angle of the normal [°]")
    return figure


def _spectrum(points: Array) -> Array:
    return hough.spectrum(transform(points))


def _profile(coordinates: Array) -> tuple[Array, Array]:
    counts, first = profile(coordinates, CONFIG.resolution)
    return (first + np.arange(len(counts)) + 0.5) * CONFIG.resolution, counts


def _figure(height: float) -> Figure:
    return Figure(figsize=(WIDTH, height), layout="constrained")


def _panels(rows: int, columns: int, height: float) -> tuple[Figure, list[Axes]]:
    figure = _figure(height)
    return figure, list(figure.subplots(rows, columns, squeeze=False).ravel())


def _map(ax: Axes, points: Array, title: str, colour: str = BLUE) -> None:
    ax.scatter(points[:, 0], points[:, 1], s=2.5, color=colour, linewidths=0)
    ax.set_aspect("equal", adjustable="datalim")
    _label(ax, title)


def _transform(ax: Axes, points: Array, title: str) -> None:
    """Votes, brightened so that the curves of single points show."""
    votes = transform(points)
    top = votes.first + votes.resolution * votes.votes.shape[1]
    ax.imshow(
        np.sqrt(votes.votes.T), origin="lower", aspect="auto", cmap="magma", interpolation="nearest",
        extent=(0.0, 180.0, votes.first, top),
    )  # fmt: skip
    _label(ax, title, "angle of the normal [°]", "distance from the origin ρ [m]")


def _curve(ax: Axes, values: Array, title: str, colour: str = BLUE, x: str = "") -> None:
    """A circular signal over half a turn; its end is its beginning."""
    ax.plot(
        np.linspace(0.0, 180.0, len(values) + 1), np.append(values, values[0]), color=colour, linewidth=0.9
    )
    ax.set_xticks(np.arange(0, 181, 30))
    ax.set_xlim(0.0, 180.0)
    ax.set_ylim(bottom=0.0)
    ax.grid(color=GREY, linewidth=0.4, alpha=0.6)
    _label(ax, title, x)


def _label(ax: Axes, title: str = "", x: str = "", y: str = "") -> None:
    ax.set_title(title, fontsize=FONT["title"], loc="left")
    ax.set_xlabel(x, fontsize=FONT["label"])
    ax.set_ylabel(y, fontsize=FONT["label"])
    ax.tick_params(labelsize=FONT["tick"])


PICTURES: dict[str, Callable[[], Figure]] = {
    "lines": _lines,
    "rooms": lambda: _with_spectrum(points_on(rooms()), "rooms: two directions, 90° apart"),
    "hexagons": lambda: _with_spectrum(points_on(hexagons()), "a beehive: three directions, 60° apart"),
    "rotation": _rotation,
    "profiles": _profiles,
    "cutout": _cutout,
    "translation": _translation,
    "hypotheses": _hypotheses,
}
"""Name -> a figure of the chapter: 3.1, 3.2, 3.3, 3.4, 3.5 and 3.6, 3.7 and 3.8, 3.9 and 3.10, 3.11."""
