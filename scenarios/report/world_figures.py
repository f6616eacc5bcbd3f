"""Pictures of a simulated world: from above, with the driven path, and one tilted scan from the side."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from scenarios.report.style import FONT, LEFT, RIGHT, WIDTH, grid, set_title
from sim.record import SimulatedRun
from sim.terrain_kernels import height_at, heights_at
from slam import se2
from slam.colours import BLACK, BLUE, GREY, ORANGE, VERMILLION
from slam.odometry.track import Verdict
from slam.se2 import Array
from stitch.mapping.estimate import Estimate

SECTOR = np.deg2rad(8.0)
"""Half the sector of beams drawn from the side: beams further off the heading would mislead."""
LEVEL_RANGE = 6.0
"""How far the beam of a level laser is drawn from the side [m]."""
GROUND_BEHIND = 0.8
"""Ground shown behind the robot [m]."""
MAX_EXTINCTION = 8.0
"""Extinction coefficient drawn darkest [1/m]: what blinds the laser would bleach the haze."""
SHADES = 6
"""Bands of colour of ground and smoke, which read like contour lines and keep the picture small."""
BAR_WIDTH, MAX_HEIGHT, THUMBNAIL_WIDTH = 0.8, 9.0, 5.0
"""Room for the colour bar, the largest height of a drawing, and the width of a thumbnail [inch]."""
MAX_TILT = 12.0
"""End of the colour scale [°]: a robot that lies on its back would bleach all else."""


def draw_from_above(run: SimulatedRun, estimate: Estimate | None = None) -> Figure:
    """Walls, furniture, terrain, smoke and movers, and the driven path coloured by its true tilt. Where the
    matcher of ``estimate`` (the Weighted Scan Matcher's, say) had no match the path is marked."""
    low, high = _extent(run)
    aspect = float((high[1] - low[1]) / (high[0] - low[0]))
    across = min(WIDTH - LEFT - RIGHT - BAR_WIDTH, MAX_HEIGHT / aspect)
    figure, (ax,) = grid(1, 1, across, across * aspect, 0.0, 0.0, beside=BAR_WIDTH)
    line = _draw_drive(ax, run, estimate)
    ax.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), xlabel="x [m]", ylabel="y [m]", aspect="equal")
    place, wide = ax.get_position(), BAR_WIDTH / figure.get_figwidth()
    inside = figure.add_axes((place.x1 + 0.2 * wide, place.y0, 0.2 * wide, place.height))
    bar = figure.colorbar(line, cax=inside, extend="max")
    bar.set_label("tilt of the robot [°]", fontsize=FONT["label"])
    bar.ax.tick_params(labelsize=FONT["tick"])
    _legend(figure, run, estimate)
    return figure


def draw_thumbnail(run: SimulatedRun, estimate: Estimate | None = None) -> Figure:
    """The same on a picture `THUMBNAIL_WIDTH` inch wide, without axes and legend, with a scale."""
    low, high = _extent(run)
    width, height = high - low
    low = low - [0.0, 0.07 * width]  # the scale lies under it
    figure = Figure(figsize=(THUMBNAIL_WIDTH, THUMBNAIL_WIDTH * (height + 0.07 * width) / width))
    ax = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    ax.set_axis_off()
    _draw_drive(ax, run, estimate)
    metres = 10 if width > 40.0 else 5
    left, y = low[0] + 0.02 * width, low[1] + 0.03 * width
    ax.plot([left, left + metres], [y, y], color=BLACK, linewidth=2.0, solid_capstyle="butt")
    ax.text(left + metres + 0.015 * width, y, f"{metres} m", fontsize=FONT["title"], va="center")
    ax.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal")
    return figure


def draw_from_the_side(run: SimulatedRun) -> Figure:
    """The scan with the most nose-down pitch of a robot on its feet, in the upright plane of its heading.

    Beams within 8° of the heading, without noise; the dashed line is where a level laser would have looked.
    """
    upright = np.max(np.abs(run.tilt), axis=1) < np.deg2rad(25.0)  # not falling over
    scan = int(np.argmax(np.where(upright, run.tilt[:, 1], -np.inf)))
    pose, ahead, up, level = _side_view(run, scan)
    reach = max(1.5, level, float(np.nanmax(np.append(ahead, 0.0))))
    figure, (ax,) = grid(1, 1, WIDTH - LEFT - RIGHT, 2.2, 0.0, 0.0)
    _draw_profile(ax, run, pose, reach)
    z = float(pose[5])
    for x, height in zip(ahead, up, strict=True):
        ax.plot([0.0, x], [z, height], color=BLUE, linewidth=0.5, alpha=0.35)
    ax.scatter(ahead, up, s=12, color=VERMILLION, zorder=4, label="what the beams met")
    ax.plot([0.0, level], [z, z], color=BLACK, linestyle="--", linewidth=0.9, label="a level laser")
    ax.plot([0.0], [z], marker="s", color=BLACK, markersize=6, linestyle="none", label="laser")
    roll, pitch = np.degrees(run.tilt[scan])
    set_title(ax, f"scan {scan}: pitch {pitch:.1f}°, roll {roll:.1f}°", "left")
    ax.set(xlim=(-GROUND_BEHIND, reach + 0.3), xlabel="distance ahead [m]", ylabel="height [m]")
    place: dict[str, Any] = {"loc": "lower right", "bbox_to_anchor": (1.0, 1.0), "borderpad": 0}
    ax.legend(fontsize=FONT["tick"], frameon=False, ncols=3, **place)
    return figure


def _draw_drive(ax: Axes, run: SimulatedRun, estimate: Estimate | None) -> LineCollection:
    """The world, the path, and where the matcher of ``estimate`` had no match."""
    _draw_ground(ax, run)
    _draw_solids(ax, run)
    truth = _truth(run)
    tilt = np.degrees(np.arccos(np.clip(np.cos(run.tilt[:, 0]) * np.cos(run.tilt[:, 1]), -1.0, 1.0)))
    pieces = np.stack([truth[:-1, :2], truth[1:, :2]], axis=1)
    line = LineCollection(list(pieces), cmap="viridis_r", linewidths=2.0, zorder=5, rasterized=True)
    line.set_array(np.maximum(tilt[:-1], tilt[1:]))
    line.set_clim(0.0, MAX_TILT)
    ax.add_collection(line)
    ax.plot(*truth[0, :2], marker="o", color=BLUE, markersize=6, zorder=6)
    if estimate is not None and estimate.track is not None:
        tried = estimate.track.verdict != Verdict.SKIPPED
        x, y, _ = truth[tried & (estimate.track.matches == 0)].T
        ax.scatter(x, y, s=26, facecolors="none", edgecolors=VERMILLION, linewidths=1.1, zorder=6)
    return line


def _truth(run: SimulatedRun) -> Array:
    assert run.recording.truth is not None
    return run.recording.truth


def _extent(run: SimulatedRun) -> tuple[Array, Array]:
    points = np.concatenate([run.walls.reshape(-1, 2), _truth(run)[:, :2]])
    return points.min(axis=0) - 0.8, points.max(axis=0) + 0.8


def _draw_ground(ax: Axes, run: SimulatedRun) -> None:
    """Uneven ground in browns, smoke in greys over it."""
    terrain, smoke = run.setup.world.terrain, run.setup.world.smoke
    _shade(ax, np.abs(terrain.heights), terrain.origin, terrain.resolution, "YlOrBr")
    if smoke is not None:
        visible = np.sqrt(np.minimum(smoke.extinction, MAX_EXTINCTION))  # shows haze beside thick smoke
        _shade(ax, visible, smoke.origin, smoke.resolution, "Greys")


def _shade(ax: Axes, values: Array, origin: tuple[float, float], resolution: float, colours: str) -> None:
    """A field in bands of colour, nothing where it is zero."""
    if not np.any(values > 0.0):
        return
    rows, columns = values.shape
    left, bottom = origin[0] - 0.5 * resolution, origin[1] - 0.5 * resolution
    box = (left, left + columns * resolution, bottom, bottom + rows * resolution)
    top = float(values.max())
    ax.imshow(
        np.where(values > 0.0, values, np.nan), cmap=colormaps[colours].resampled(SHADES), alpha=0.55,
        vmin=-0.2 * top, vmax=top, origin="lower", extent=box, interpolation="none", zorder=0,
    )  # fmt: skip


def _draw_solids(ax: Axes, run: SimulatedRun) -> None:
    """What a level laser sees in black, what it sees over or under in outline, movers at the first scan."""
    world, height = run.setup.world, run.setup.scanner.height
    seen = [p.footprint for p in world.prisms if p.z_lo <= height <= p.z_hi]
    missed = [p.footprint for p in world.prisms if not p.z_lo <= height <= p.z_hi]
    ax.add_collection(PolyCollection(missed, facecolors="none", edgecolors=GREY, linewidths=0.8, zorder=2))
    ax.add_collection(PolyCollection(seen, facecolors=BLACK, edgecolors=BLACK, linewidths=0.3, zorder=3))
    shapes = [debris.shape for debris in world.debris] + [person.shape for person in world.people]
    for place, shape in zip(run.movers[0], shapes, strict=True):
        outline = se2.transform(place, shape.footprint)
        closed = np.concatenate([outline, outline[:1]])
        ax.add_collection(LineCollection([closed], colors=ORANGE, linewidths=1.2, zorder=4))


def _legend(figure: Figure, run: SimulatedRun, estimate: Estimate | None) -> None:
    world = run.setup.world
    entries = [
        ("at the laser's height", "s", BLACK, BLACK),
        ("lower or higher", "s", "none", GREY),
        ("start", "o", BLUE, BLUE),
    ]
    if world.debris or world.people:
        entries.append(("moves (at the start)", "s", "none", ORANGE))
    if estimate is not None:
        entries.append((f"{estimate.method}: no match", "o", "none", VERMILLION))
    handles = [
        Line2D([], [], linestyle="none", label=label, marker=marker, mfc=face, mec=edge)
        for label, marker, face, edge in entries
    ]
    size, columns = FONT["tick"], len(entries)
    figure.legend(handles=handles, fontsize=size, frameon=False, ncols=columns, loc="lower center")


def _side_view(run: SimulatedRun, scan: int) -> tuple[Array, Array, Array, float]:
    """Pose ``(6,)`` of the laser at a scan; of each beam near the heading the distance ahead and the height
    of what it truly met, NaN without; and how far a level laser would have seen, as far as is drawn [m]."""
    scanner, world = run.setup.scanner, run.setup.world
    x, y, yaw = _truth(run)[scan]
    ground = height_at(float(x), float(y), world.terrain.field)
    pose = scanner.sensor_poses(np.array([x, y, yaw, *run.tilt[scan], ground]))
    angles = scanner.angles[np.abs(scanner.angles) <= SECTOR]
    caster = scanner.caster(world)
    ranges = caster.cast(pose[None], angles + scanner.mount[2], scanner.range_max)[0]
    roll, pitch = pose[3], pose[4]
    c, s = np.cos(angles), np.sin(angles)
    ahead = ranges * (np.cos(pitch) * c + np.sin(pitch) * np.sin(roll) * s)
    up = ranges * (-np.sin(pitch) * c + np.cos(pitch) * np.sin(roll) * s)
    level = pose * [1.0, 1.0, 1.0, 0.0, 0.0, 1.0]
    met = caster.cast(level[None], np.zeros(1), scanner.range_max)[0, 0]
    return pose, ahead, pose[5] + up, float(np.fmin(met, min(scanner.range_max, LEVEL_RANGE)))


def _draw_profile(ax: Axes, run: SimulatedRun, pose: Array, reach: float) -> None:
    """The ground along the heading, and what stands on the heading."""
    world = run.setup.world
    along = np.arange(-GROUND_BEHIND, reach + 0.3, 0.02)
    line = pose[:2] + along[:, None] * np.array([np.cos(pose[2]), np.sin(pose[2])])
    ground = heights_at(np.ascontiguousarray(line), world.terrain.field)
    ax.fill_between(along, ground, min(-0.15, float(ground.min()) - 0.1), color=GREY, linewidth=0.0)
    ceiling = float(pose[5]) + 0.7
    for prism in world.prisms:
        inside = along[_inside(line, prism.footprint)]
        if len(inside):
            low, top = max(prism.z_lo, 0.0), min(prism.z_hi, ceiling)
            ax.fill_between([inside[0], inside[-1] + 0.02], low, top, color=BLACK, alpha=0.75, linewidth=0.0)
    ax.set_ylim(float(ground.min()) - 0.1, ceiling)


def _inside(points: Array, footprint: Array) -> np.ndarray:
    """Points ``(n, 2)`` inside a convex counter-clockwise footprint."""
    edges = np.roll(footprint, -1, axis=0) - footprint
    offset = points[:, None] - footprint
    return np.all(edges[:, 0] * offset[..., 1] - edges[:, 1] * offset[..., 0] >= 0.0, axis=1)
