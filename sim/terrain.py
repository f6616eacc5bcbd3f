"""The ground: a height field, with ramps, sills and rubble."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike
from scipy.ndimage import gaussian_filter

from sim.terrain_kernels import HeightField
from slam.se2 import Array


@dataclass(frozen=True)
class Terrain:
    """Heights and roughness on a grid of nodes, bilinear in between, level ground at height 0 outside.

    ``heights (rows, columns)`` m at ``origin + resolution * (column, row)``; ``roughness`` of the same
    shape is the standard deviation [rad] that loose rubble adds to the tilt of a robot that drives over it.
    """

    heights: Array
    roughness: Array
    origin: tuple[float, float]
    resolution: float

    def __post_init__(self) -> None:
        shape = self.heights.shape
        if len(shape) != 2 or min(shape) < 2 or shape != self.roughness.shape:
            raise ValueError("terrain: heights and roughness need the same shape, at least (2, 2)")
        if not (np.all(np.isfinite(self.heights)) and np.all(self.roughness >= 0.0)):
            raise ValueError("terrain: expected finite heights and roughness >= 0")

    @classmethod
    def level(cls, lower: ArrayLike, upper: ArrayLike, resolution: float = 0.05) -> Terrain:
        """Level ground over the rectangle from ``lower (2,)`` to ``upper (2,)`` m."""
        lower, upper = np.asarray(lower, dtype=np.float64), np.asarray(upper, dtype=np.float64)
        columns, rows = np.ceil((upper - lower) / resolution).astype(int) + 1
        zeros = np.zeros((int(rows), int(columns)))
        return cls(zeros, zeros.copy(), (float(lower[0]), float(lower[1])), resolution)

    @property
    def field(self) -> HeightField:
        """The height field, for the kernels."""
        heights = np.ascontiguousarray(self.heights)
        return HeightField(heights, *self.origin, self.resolution, max(0.0, float(heights.max())))

    @property
    def roughness_field(self) -> HeightField:
        """The roughness, to be looked up like a height."""
        return self.field._replace(heights=np.ascontiguousarray(self.roughness))

    def nodes(self) -> tuple[Array, Array]:
        """x and y of every node, each ``(rows, columns)`` m."""
        return self.field.nodes()

    def with_ramp(self, a: ArrayLike, b: ArrayLike, width: float, rise: float) -> Terrain:
        """A ramp from the ground at ``a (2,)`` up to ``rise`` m at ``b (2,)``, where it drops: a ledge."""
        along, _, length, inside = self._strip(a, b, width)
        return self._raised(np.where(inside, rise * along / length, 0.0))

    def with_steps(self, a: ArrayLike, b: ArrayLike, width: float, rise: float, count: int) -> Terrain:
        """A flight of ``count`` equal steps from the ground at ``a (2,)`` up to ``rise`` m at ``b (2,)``."""
        along, _, length, inside = self._strip(a, b, width)
        step = np.clip(np.floor(along / length * count + 1e-9) + 1.0, 1.0, count)
        return self._raised(np.where(inside, rise * step / count, 0.0))

    def with_platform(self, lower: ArrayLike, upper: ArrayLike, height: float) -> Terrain:
        """The rectangle from ``lower (2,)`` to ``upper (2,)`` m raised to a level ``height`` m."""
        return self._raised(np.where(self._depth(lower, upper) >= 0.0, height, 0.0))

    def with_sill(self, a: ArrayLike, b: ArrayLike, height: float, depth: float) -> Terrain:
        """A door sill: a rounded bar from ``a (2,)`` to ``b (2,)``, ``depth`` m across, ``height`` m high."""
        _, across, _, inside = self._strip(a, b, depth)
        return self._raised(np.where(inside, height * np.cos(np.pi * across / depth), 0.0))

    def with_rubble(
        self, centre: ArrayLike, radius: float, height: float, roughness: float, rng: np.random.Generator
    ) -> Terrain:
        """A round heap of debris: random bumps of typical ``height`` m, fading at its edge.

        ``roughness`` [rad] is the tilt its loose parts add to a robot driving over it.
        """
        x, y = self.nodes()
        cx, cy = np.asarray(centre, dtype=np.float64)
        fade = np.clip(1.5 * (1.0 - np.hypot(x - cx, y - cy) / radius), 0.0, 1.0)
        return self._strewn(fade, height, roughness, rng)

    def with_rubble_field(
        self,
        lower: ArrayLike,
        upper: ArrayLike,
        height: float,
        roughness: float,
        rng: np.random.Generator,
        grain: float = 0.25,
    ) -> Terrain:
        """Rubble of bumps ``grain`` m in size, over the rectangle from ``lower (2,)`` to ``upper (2,)`` m.

        It fades over the outer 0.3 m. A ``grain`` of metres without roughness makes hills.
        """
        fade = np.clip(self._depth(lower, upper) / 0.3, 0.0, 1.0)
        return self._strewn(fade, height, roughness, rng, grain)

    def _strewn(
        self, fade: Array, height: float, roughness: float, rng: np.random.Generator, grain: float = 0.25
    ) -> Terrain:
        """Rubble where ``fade (rows, columns)``, from 0 to 1, lets it be."""
        noise = rng.standard_normal(self.heights.shape)
        noise = gaussian_filter(noise, grain / self.resolution, mode="reflect")
        bumps = np.abs(noise) * (height / np.abs(noise).mean())
        rough = np.maximum(self.roughness, fade * roughness)
        return replace(self, heights=np.maximum(self.heights, fade * bumps), roughness=rough)

    def _depth(self, lower: ArrayLike, upper: ArrayLike) -> Array:
        """Distance [m] of every node inwards from the nearest side of a rectangle; negative outside it."""
        (x0, y0), (x1, y1) = np.asarray(lower, dtype=np.float64), np.asarray(upper, dtype=np.float64)
        x, y = self.nodes()
        tolerance = 1e-9  # nodes on the border belong to it
        return np.minimum(np.minimum(x - x0, x1 - x), np.minimum(y - y0, y1 - y)) + tolerance

    def _raised(self, heights: Array) -> Terrain:
        return replace(self, heights=np.maximum(self.heights, heights))

    def _strip(self, a: ArrayLike, b: ArrayLike, width: float) -> tuple[Array, Array, float, np.ndarray]:
        """Coordinates of every node along and across the line from a to b, its length, and which nodes lie on
        a strip of this ``width`` m along it."""
        a, b = np.asarray(a, dtype=np.float64), np.asarray(b, dtype=np.float64)
        length = float(np.hypot(*(b - a)))
        ux, uy = (b - a) / length
        x, y = self.nodes()
        along, across = (x - a[0]) * ux + (y - a[1]) * uy, (y - a[1]) * ux - (x - a[0]) * uy
        inside = (np.abs(across) <= 0.5 * width) & (along >= 0.0) & (along <= length)
        return along, across, length, inside
