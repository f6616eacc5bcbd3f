"""Two recordings of one building: the second drive goes back, and furniture may have been moved."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from scenarios.ablate.trial_io import stream
from scenarios.catalogue.building import start
from sim.driver import resample
from sim.floorplan import Prism
from sim.record import Buildable, Setup, SimulatedRun, drive, observe
from slam import se2
from slam.se2 import Array

SHARE_MOVED = 0.5
"""Share of the furniture that is moved."""
LARGEST = 2.5
"""Furniture larger than this [m] stays."""
FARTHEST = 1.5
"""Largest displacement on each axis [m]."""
CLEARANCE = 0.45
"""Least distance of moved furniture from the route [m]."""
TRIES = 12
"""Random places that are tried for a piece before it is removed."""


def record_two_sessions(scenario: Buildable, seed: int, moved: bool) -> tuple[SimulatedRun, SimulatedRun]:
    """A drive through a scenario, and one back along its route; between them furniture may be ``moved``."""
    rng = stream(seed, scenario.name, "sessions")
    building, moving, *streams = rng.spawn(8)
    first = scenario.build(building)
    prisms = rearrange(first.world.prisms, resample(first.waypoints), moving) if moved else first.world.prisms
    route = first.waypoints[::-1]
    second = replace(first, world=replace(first.world, prisms=prisms), waypoints=route, start=start(route))
    return _record(scenario.name, first, streams[:3]), _record(scenario.name, second, streams[3:])


def _record(name: str, setup: Setup, streams: Sequence[np.random.Generator]) -> SimulatedRun:
    driving, scanning, reckoning = streams
    return observe(name, setup, drive(setup, driving), scanning, reckoning)


def rearrange(prisms: tuple[Prism, ...], route: Array, rng: np.random.Generator) -> tuple[Prism, ...]:
    """The prisms with `SHARE_MOVED` of the furniture moved within its rooms, off the ``route (P, 2)`` m, or
    removed where there is no other place."""
    pieces = _furniture(prisms)
    outlines = [_outline(prism) for prism in prisms]
    new = list(prisms)
    gone: set[int] = set()
    for piece in pieces:
        size = np.ptp(np.concatenate([prisms[k].footprint for k in piece]), axis=0).max()
        if size > LARGEST or rng.random() > SHARE_MOVED:
            continue
        others = cKDTree(
            np.concatenate([o for k, o in enumerate(outlines) if k not in piece and k not in gone])
        )
        placed = _place([prisms[k] for k in piece], others, cKDTree(route), rng)
        for k, prism in zip(piece, placed or [], strict=False):
            new[k], outlines[k] = prism, _outline(prism)
        gone.update([] if placed else piece)
    return tuple(prism for k, prism in enumerate(new) if k not in gone)


def _furniture(prisms: tuple[Prism, ...]) -> list[list[int]]:
    """Indices of the prisms of each piece of furniture: those whose boxes touch, seen from above."""
    rows = [k for k, prism in enumerate(prisms) if prism.kind == "furniture"]
    if not rows:
        return []
    low = np.array([prisms[k].footprint.min(axis=0) for k in rows]) - 0.01
    high = np.array([prisms[k].footprint.max(axis=0) for k in rows]) + 0.01
    touch = np.all((low[:, None] <= high[None]) & (low[None] <= high[:, None]), axis=2)
    _, label = connected_components(coo_array(touch), directed=False)
    return [[rows[i] for i in np.flatnonzero(label == k)] for k in range(label.max() + 1)]


def _outline(prism: Prism) -> Array:
    return resample(np.vstack([prism.footprint, prism.footprint[:1]]), 0.1)


def _place(
    piece: Sequence[Prism], others: cKDTree, route: cKDTree, rng: np.random.Generator
) -> list[Prism] | None:
    """The piece at another place of its room, None where no place is free."""
    centre = np.concatenate([prism.footprint for prism in piece]).mean(axis=0)
    for _ in range(TRIES):
        shift, turn = (
            rng.uniform(-FARTHEST, FARTHEST, 2),
            rng.choice([0.0, 0.5 * np.pi]) + rng.normal(0.0, 0.1),
        )
        T = se2.compose(np.array([*(centre + shift), turn]), np.array([*-centre, 0.0]))
        placed = [replace(prism, footprint=se2.transform(T, prism.footprint)) for prism in piece]
        outline = np.concatenate([_outline(prism) for prism in placed])
        way = centre + np.linspace(0.0, 1.0, 20)[:, None] * shift
        if min(others.query(outline)[0].min(), others.query(way)[0].min()) < 0.05:
            continue
        if route.query(outline)[0].min() > CLEARANCE:
            return placed
    return None
