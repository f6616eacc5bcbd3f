"""What lies under everything: maps, true walls, smoke and uneven ground, as images with their place."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from scenarios.report.live.packed import packed, picture
from slam.mapping.occupancy import Grid
from slam.se2 import Array

if TYPE_CHECKING:
    from sim.record import SimulatedRun

UNKNOWN, FREE, WALL = 0, 128, 255
"""Grey values of a map's image."""


def surroundings(simulated: SimulatedRun | None) -> dict[str, object]:
    """The true walls at the laser's height, smoke and uneven ground; None for what is not known or not
    there."""
    if simulated is None:
        return {"walls": None, "smoke": None, "terrain": None}
    world = simulated.setup.world
    terrain, smoke = world.terrain, world.smoke
    return {
        "walls": packed(simulated.walls, "i2", 0.005) if len(simulated.walls) else None,
        "smoke": None if smoke is None else _field(smoke.extinction, smoke.origin, smoke.resolution),
        "terrain": _field(np.abs(terrain.heights), terrain.origin, terrain.resolution),
    }


def map_image(grid: Grid) -> dict[str, object]:
    """A map: which cells are walls and which are free."""
    shades = np.where(grid.occupied, WALL, np.where(grid.free, FREE, UNKNOWN)).astype(np.uint8)
    return _image(shades, grid.origin, grid.resolution)


def _field(values: Array, origin: tuple[float, float], resolution: float) -> dict[str, object] | None:
    """A field over nodes, brightest where it is highest; None where it is zero everywhere."""
    top = float(values.max(initial=0.0))
    if top <= 0.0:
        return None
    step = max(1, round(0.1 / resolution))
    some = values[::step, ::step]
    corner = np.asarray(origin) - 0.5 * resolution * step
    shades = np.rint(255.0 * np.sqrt(np.clip(some / top, 0.0, 1.0))).astype(np.uint8)
    return {**_image(shades, corner, resolution * step), "top": top}


def _image(shades: np.ndarray, origin: Array, resolution: float) -> dict[str, object]:
    """Grey values ``(H, W)`` with row 0 at the bottom, and the corners of their place [m]."""
    import cv2

    done, data = cv2.imencode(".png", shades[::-1], [cv2.IMWRITE_PNG_COMPRESSION, 6])
    if not done:
        raise RuntimeError(f"OpenCV cannot encode an image of {shades.shape}")
    x, y = (round(float(value), 4) for value in origin)
    height, width = shades.shape
    corners = [x, y, round(x + width * resolution, 4), round(y + height * resolution, 4)]
    return {"image": picture(data.tobytes()), "corners": corners}
