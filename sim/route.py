"""A route through the free space of an occupancy map: out to far places, home, and round again."""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np
from scipy.ndimage import label, uniform_filter1d
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

from slam.mapping.occupancy import Grid
from slam.se2 import Array

MARGIN = 0.06
"""What the robot keeps from everything that is not free, beyond its own radius [m]."""
COMFORT, DISCOMFORT = 0.5, 10.0
"""With less clearance than this [m] a metre counts as 1 + DISCOMFORT (COMFORT / clearance - 1)² metres."""
SPACING = 0.1
"""Nodes of the search are about this far apart [m]."""
REACH, LONGEST = 25.0, 250.0
"""Places to go lie within this of the start, and the route is no longer than that [m]."""
MOST_GOALS, LEAST_APART = 8, 2.0
"""How many places there are to go to, and how far apart [m]."""
LEAST_DRIVE = 1.0
"""A route that never gets this far from its start [m] is none."""


class NoRouteError(ValueError):
    """Nobody can drive here; the message says why, in one line."""


class _Roads(NamedTuple):
    """Places ``(V, 2)`` m where the robot fits, and the ``graph`` of the steps between neighbours, weighed by
    length and narrowness."""

    places: Array
    graph: csr_array


def clearance(grid: Grid) -> Array:
    """Distance ``(H, W)`` m of each free cell's centre from the nearest cell that is not free, 0 elsewhere.

    Outside of the map nothing is free.
    """
    import cv2

    free = np.pad(grid.free, 1).astype(np.uint8)
    distance = cv2.distanceTransform(free, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)[1:-1, 1:-1]
    return np.maximum(distance.astype(np.float64) - 0.5, 0.0) * grid.resolution


def plan(
    grid: Grid, radius: float, rng: np.random.Generator, start: tuple[float, float] | None = None
) -> Array:
    """Waypoints ``(K, 2)`` m for a robot of this ``radius`` m: through places far from each other, home, and
    once more to all of them, in the same order or the other way round.

    ``start`` (x, y) m is drawn where it is None. Raises `NoRouteError`.
    """
    if not np.any(grid.free):
        raise NoRouteError("no free space, expected free cells to drive in")
    room = clearance(grid)
    if start is not None:
        _check_start(grid, room, start, radius)
    roads = _roads(grid, room, radius, start)
    home = int(rng.integers(len(roads.places))) if start is None else _nearest(roads.places, start)
    stops, lengths, before = _stops(roads, home, rng)
    tour = _tour(stops, lengths)
    again = tour if rng.random() < 0.5 else tour[::-1]
    nodes = [home]
    for a, b in pairwise([*tour, *again[1:]]):
        way = [stops[b]]
        while before[a][way[-1]] != stops[a]:
            way.append(int(before[a][way[-1]]))
        nodes += way[::-1]
    exact = roads.places[nodes]  # without the zigzag of the grid, wherever that leaves enough clearance
    smooth = uniform_filter1d(exact, 5, axis=0, mode="nearest")
    column, row = np.floor((smooth - grid.origin) / grid.resolution).astype(int).T
    enough = room[row, column] >= radius + MARGIN
    return np.where(enough[:, None], smooth, exact)


def _check_start(grid: Grid, room: Array, start: tuple[float, float], radius: float) -> None:
    x, y = start
    column, row = np.floor((np.array(start) - grid.origin) / grid.resolution).astype(int)
    where = f"start ({x:g}, {y:g})"
    if not (0 <= row < grid.free.shape[0] and 0 <= column < grid.free.shape[1]):
        x0, x1, y0, y1 = grid.extent
        inside = f"x in {x0:g}..{x1:g} and y in {y0:g}..{y1:g}"
        raise NoRouteError(f"{where} is outside of the map, expected {inside}")
    if grid.occupied[row, column]:
        raise NoRouteError(f"{where} is inside a wall, expected free space")
    if not grid.free[row, column]:
        raise NoRouteError(f"{where} is in unknown space, expected free space")
    if room[row, column] < radius:
        need = f"expected at least the robot's radius of {radius:.2f} m"
        raise NoRouteError(f"{where} is {room[row, column]:.2f} m from what is not free, {need}")


def _roads(grid: Grid, room: Array, radius: float, start: tuple[float, float] | None) -> _Roads:
    """The connected region that holds the start, or the largest.

    Every second, third … cell will do as a node: between two neighbours the clearance is less than at either
    by no more than half their distance.
    """
    stride = max(1, round(SPACING / grid.resolution))
    sampled = room[stride // 2 :: stride, stride // 2 :: stride]
    fits = sampled >= radius + min(MARGIN, 0.75 * stride * grid.resolution)
    if not np.any(fits):
        widest = f"the widest free place is {2.0 * room.max():.2f} m across"
        need = f"expected {2.0 * (radius + MARGIN):.2f} m"
        raise NoRouteError(f"no place where the robot fits: {widest}, {need}")
    regions, _ = label(fits, structure=np.ones((3, 3)))
    rows, columns = np.nonzero(fits)
    cells = stride * np.stack([columns, rows], -1) + stride // 2
    places = grid.origin + (cells + 0.5) * grid.resolution
    region = regions[rows, columns]
    chosen = np.argmax(np.bincount(region)) if start is None else region[_nearest(places, start)]
    inside = region == chosen
    rows, columns, places = rows[inside], columns[inside], places[inside]
    index = np.full(fits.shape, -1)
    index[rows, columns] = np.arange(len(rows))
    free = sampled[rows, columns]
    return _Roads(places, _graph(index, free, stride * grid.resolution))


def _graph(index: np.ndarray, free: Array, spacing: float) -> csr_array:
    """Steps to the eight neighbours, from node numbers ``index (H, W)``, -1 where there is none."""
    height, width = index.shape
    pairs, lengths = [], []
    for dy, dx in ((0, 1), (1, 0), (1, 1), (1, -1)):
        a = index[: height - dy, max(0, -dx) : width - max(0, dx)]
        b = index[dy:, max(0, dx) : width + min(0, dx)]
        both = (a >= 0) & (b >= 0)
        pairs.append(np.stack([a[both], b[both]]))
        lengths.append(np.full(np.count_nonzero(both), spacing * np.hypot(dx, dy)))
    a, b = np.concatenate(pairs, axis=1)
    narrow = np.maximum(COMFORT / np.minimum(free[a], free[b]) - 1.0, 0.0)
    weights = np.concatenate(lengths) * (1.0 + DISCOMFORT * narrow**2)
    n = len(free)
    return csr_array((np.tile(weights, 2), (np.concatenate([a, b]), np.concatenate([b, a]))), shape=(n, n))


def _nearest(places: Array, point: tuple[float, float]) -> int:
    return int(np.argmin(np.hypot(places[:, 0] - point[0], places[:, 1] - point[1])))


def _stops(roads: _Roads, home: int, rng: np.random.Generator) -> tuple[list[int], Array, np.ndarray]:
    """Home and places far from it and from each other: nodes, road lengths ``(G, G)`` between them, and for
    each the node before every node on the road from there ``(G, V)``.
    """
    stops, distances, before = [home], [], []
    while True:
        distance, previous = dijkstra(roads.graph, indices=stops[-1], return_predecessors=True)
        distances.append(distance)
        before.append(previous)
        nearest = np.min(distances, axis=0)
        nearest[distances[0] > REACH] = 0.0
        far = nearest.max()
        if far < (LEAST_DRIVE if len(stops) == 1 else LEAST_APART) or len(stops) > MOST_GOALS:
            break
        candidates = np.flatnonzero(nearest > 0.85 * far)
        stops.append(int(candidates[rng.integers(len(candidates))]))
    if len(stops) == 1:
        span = f"gets no further than {far:.2f} m from its start"
        raise NoRouteError(f"no room to drive: the robot {span}, expected at least {LEAST_DRIVE:g} m")
    return stops, np.array(distances)[:, stops], np.array(before)


def _tour(stops: list[int], lengths: Array) -> list[int]:
    """From home (0) always to the nearest stop not yet visited, and home; the last stops are dropped until
    two rounds are short enough.
    """
    for count in range(len(stops), 1, -1):
        tour, left = [0], set(range(1, count))
        while left:
            tour.append(min(left, key=lambda k: lengths[tour[-1], k]))
            left.remove(tour[-1])
        tour.append(0)
        if 2.0 * sum(lengths[a, b] for a, b in pairwise(tour)) <= LONGEST:
            break
    return tour
