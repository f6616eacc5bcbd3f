"""Walls and furniture: convex footprints with a vertical extent. Walls also from an occupancy map."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from slam import se2
from slam.mapping.occupancy import Grid
from slam.se2 import Array

Kind = Literal["wall", "furniture"]

WALL_THICKNESS = 0.12
WALL_HEIGHT = 2.5
BELOW_FLOOR = -1.0
"""Things on the floor reach this far down [m], so that no ray slips under them on uneven ground."""


@dataclass(frozen=True)
class Prism:
    """An upright solid: convex ``footprint (k, 2)`` m, counter-clockwise, between heights ``z_lo`` and
    ``z_hi`` m.

    Raises ``ValueError`` for a footprint that is not convex and counter-clockwise, or an empty extent.
    """

    footprint: Array
    z_lo: float
    z_hi: float
    kind: Kind = "wall"

    def __post_init__(self) -> None:
        footprint = np.ascontiguousarray(self.footprint, dtype=np.float64)
        object.__setattr__(self, "footprint", footprint)
        if footprint.ndim != 2 or footprint.shape[0] < 3 or footprint.shape[1] != 2:
            raise ValueError(f"footprint: expected shape (k >= 3, 2), got {footprint.shape}")
        edges = np.roll(footprint, -1, axis=0) - footprint
        after = np.roll(edges, -1, axis=0)
        if np.any(edges[:, 0] * after[:, 1] - edges[:, 1] * after[:, 0] <= 0.0):
            raise ValueError("footprint: expected a strictly convex, counter-clockwise polygon")
        if not self.z_lo < self.z_hi:
            raise ValueError(f"vertical extent: expected z_lo < z_hi, got {self.z_lo} and {self.z_hi}")

    @property
    def edges(self) -> Array:
        """The outline as segments ``(k, 4)``: x1, y1, x2, y2."""
        return np.hstack([self.footprint, np.roll(self.footprint, -1, axis=0)])


@dataclass(frozen=True)
class Door:
    """An opening in a wall: its centre, as a distance from the wall's start, and its width [m]."""

    centre: float
    width: float = 1.0


def box(
    pose: ArrayLike,
    length: float,
    width: float,
    z_lo: float = BELOW_FLOOR,
    z_hi: float = WALL_HEIGHT,
    kind: Kind = "furniture",
) -> Prism:
    """A box centred at ``pose (3,)``: ``length`` along its x, ``width`` along its y [m]."""
    half = 0.5 * np.array([[-length, -width], [length, -width], [length, width], [-length, width]])
    return Prism(se2.transform(pose, half), z_lo, z_hi, kind)


def wall(
    a: ArrayLike,
    b: ArrayLike,
    doors: Sequence[Door] = (),
    thickness: float = WALL_THICKNESS,
    height: float = WALL_HEIGHT,
) -> list[Prism]:
    """A straight wall from ``a (2,)`` to ``b (2,)`` with openings, as one prism for each solid piece.

    Both ends reach half a thickness further, so that walls that meet leave no gap.
    Raises ``ValueError`` for a door that does not lie within the wall or overlaps another.
    """
    a, b = np.asarray(a, dtype=np.float64), np.asarray(b, dtype=np.float64)
    length = float(np.hypot(*(b - a)))
    yaw = float(np.arctan2(*(b - a)[::-1]))
    cuts = [-0.5 * thickness]
    for door in sorted(doors, key=lambda d: d.centre):
        cuts += [door.centre - 0.5 * door.width, door.centre + 0.5 * door.width]
    cuts.append(length + 0.5 * thickness)
    if np.any(np.diff(cuts) <= 0.0):
        raise ValueError(f"doors do not fit in a wall of {length:.2f} m: {list(doors)}")
    along = (b - a) / length
    return [
        box([*(a + 0.5 * (lo + hi) * along), yaw], hi - lo, thickness, z_hi=height, kind="wall")
        for lo, hi in zip(cuts[::2], cuts[1::2], strict=True)
    ]


def bed(pose: ArrayLike, length: float = 2.0, width: float = 0.9) -> list[Prism]:
    """A hospital bed: a mattress on four thin legs, which a level laser 0.3 m high passes under."""
    mattress = box(pose, length, width, 0.36, 0.62)
    return [mattress, *_legs(pose, length, width, 0.36)]


def desk(pose: ArrayLike, length: float = 1.4, width: float = 0.7) -> list[Prism]:
    """A desk: a thin top on four legs, and a drawer unit at one end that a level laser sees."""
    top = box(pose, length, width, 0.70, 0.74)
    drawers = box(se2.compose(pose, [0.5 * length - 0.25, 0.0, 0.0]), 0.4, width - 0.1, z_hi=0.68)
    return [top, drawers, *_legs(pose, length, width, 0.70)]


def table(pose: ArrayLike, length: float = 1.4, width: float = 0.7, height: float = 0.74) -> list[Prism]:
    """A table: a thin top on four legs, under which one sees through."""
    return [box(pose, length, width, height - 0.04, height), *_legs(pose, length, width, height - 0.04)]


def cupboard(pose: ArrayLike, length: float = 1.0, width: float = 0.45, height: float = 1.8) -> list[Prism]:
    """A cupboard, solid from the floor up."""
    return [box(pose, length, width, z_hi=height)]


def column(centre: ArrayLike, radius: float, sides: int = 12, height: float = WALL_HEIGHT) -> Prism:
    """A column or a tree's trunk, with ``sides`` sides around ``centre (2,)`` m."""
    return round_prism(centre, radius, sides, BELOW_FLOOR, height, "wall")


def stone(centre: ArrayLike, radius: float, height: float, rng: np.random.Generator) -> Prism:
    """An irregular block around ``centre (2,)``: six corners on an ellipse within ``radius`` m."""
    angles = 2.0 * np.pi * (np.arange(6) + rng.uniform(-0.35, 0.35, 6)) / 6.0
    corners = rng.uniform(0.6, 1.0, 2) * radius * np.stack([np.cos(angles), np.sin(angles)], -1)
    pose = [*np.asarray(centre, dtype=np.float64), rng.uniform(-np.pi, np.pi)]
    return Prism(se2.transform(pose, corners), BELOW_FLOOR, height, "furniture")


def round_prism(centre: ArrayLike, radius: float, sides: int, z_lo: float, z_hi: float, kind: Kind) -> Prism:
    """A regular polygon with its corners ``radius`` m around ``centre (2,)``, as an upright solid."""
    angles = 2.0 * np.pi * np.arange(sides) / sides
    corners = radius * np.stack([np.cos(angles), np.sin(angles)], -1)
    return Prism(np.asarray(centre, dtype=np.float64) + corners, z_lo, z_hi, kind)


def _legs(pose: ArrayLike, length: float, width: float, height: float, side: float = 0.05) -> list[Prism]:
    x, y = 0.5 * (length - side), 0.5 * (width - side)
    corners = [[x, y, 0.0], [-x, y, 0.0], [-x, -y, 0.0], [x, -y, 0.0]]
    return [box(se2.compose(pose, corner), side, side, z_hi=height) for corner in corners]


TOLERANCE = 0.75
"""Outlines may leave the centres of the cells they follow by this many cells."""


def wall_lines(grid: Grid, tolerance: float = TOLERANCE) -> Array:
    """Segments ``(S, 4)`` m along the centres of the outermost cells of everything occupied.

    Outlines and holes of connected regions (Suzuki and Abe 1985, as OpenCV has it), made straight to within
    ``tolerance`` cells (Douglas and Peucker 1973). A lone cell gives a segment without length.
    """
    import cv2

    image = np.ascontiguousarray(grid.occupied, dtype=np.uint8)
    contours, _ = cv2.findContours(image, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
    lines = [np.empty((0, 4))]
    for contour in contours:
        corners = cv2.approxPolyDP(contour, tolerance, True)[:, 0, :].astype(np.float64)
        lines.append(np.hstack([corners, np.roll(corners, -1, axis=0)]))
    segments = np.vstack(lines)
    swap = (segments[:, 0] > segments[:, 2]) | (
        (segments[:, 0] == segments[:, 2]) & (segments[:, 1] > segments[:, 3])
    )
    segments[swap] = segments[swap][:, [2, 3, 0, 1]]
    segments = np.unique(segments, axis=0)  # the outline of a wall one cell thick goes there and back again
    return np.tile(grid.origin, 2) + (segments + 0.5) * grid.resolution


def walls_of_map(grid: Grid, height: float = WALL_HEIGHT, yaw: float = 0.0) -> list[Prism]:
    """Everything occupied as walls one cell thick and ``height`` m high, hollow where it is thicker; all
    turned by ``yaw`` rad about the origin."""
    prisms = []
    ends = se2.transform(np.array([0.0, 0.0, yaw]), wall_lines(grid).reshape(-1, 2))
    for x1, y1, x2, y2 in ends.reshape(-1, 4).tolist():
        length, yaw = float(np.hypot(x2 - x1, y2 - y1)), float(np.arctan2(y2 - y1, x2 - x1))
        centre = [0.5 * (x1 + x2), 0.5 * (y1 + y2), yaw]
        prisms.append(box(centre, length + grid.resolution, grid.resolution, z_hi=height, kind="wall"))
    return prisms
