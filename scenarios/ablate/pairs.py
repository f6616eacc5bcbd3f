"""Pairs of submaps from two visits, by how much of what they saw is the same."""

from __future__ import annotations

import zlib
from dataclasses import dataclass
from itertools import product

import numpy as np

from scenarios.ablate.hold import hold
from scenarios.ablate.pieces import CELL, LENGTH, Piece, pieces
from scenarios.ablate.visits import visits
from sim.record import Buildable
from slam import se2
from slam.mapping.submap import Submap
from slam.se2 import Array

BINS: dict[str, tuple[float, float]] = {
    "15 %": (0.10, 0.20),
    "30 %": (0.25, 0.35),
    "50 %": (0.42, 0.58),
    "80 %": (0.70, 0.90),
}
"""True overlap from (inclusive) and to (exclusive), as a share of the smaller map's known area."""
NONE, TWINS = "none", "twins"
"""Pairs of one building that share nothing; pairs from rows of identical rooms, however they overlap."""
ALL_BINS = (*BINS, NONE, TWINS)
TWIN_SCENARIO = "twin_rooms"
NEIGHBOURHOOD = 4.0
"""What scans whose view is centred farther than this from the overlap [m] say of it counts little."""


@dataclass(frozen=True)
class Pair:
    """Two submaps and the truth about them.

    ``T_a_b (3,)`` is the true pose of b's frame in a's, as both maps are drawn where they overlap (a bent map
    has another one elsewhere); ``middle_b (2,)``: the middle of the overlap in b's frame, where errors are
    measured; ``overlap``: cells that both have seen, as a share of the smaller map's; ``moved``: somebody
    moved the furniture between the visits; ``hold``: metres of wall by which the one holds the other in the
    direction in which it does least (`scenarios.ablate.hold`).
    """

    scenario: str
    seed: int
    bin: str
    a: Submap
    b: Submap
    T_a_b: Array
    middle_b: Array
    overlap: float
    moved: bool
    hold: float


@dataclass(frozen=True)
class Harvest:
    """The pairs of one building, and how many stretches were cut and left out as bent."""

    pairs: tuple[Pair, ...]
    stretches: int
    bent: int


def is_moved(scenario: str, seed: int) -> bool:
    """Whether furniture is moved between the visits to a building: to every third."""
    return (seed + zlib.crc32(scenario.encode())) % 3 == 0


def harvest(
    scenario: Buildable,
    seed: int,
    quota: int,
    length: tuple[float, float] = LENGTH,
    moved: bool | None = None,
) -> Harvest:
    """At most ``quota`` pairs per bin from two visits, between which furniture is ``moved`` where `is_moved`
    says so, unless told.

    ``length``: of the shortest and the longest stretch [m].
    """
    moved = is_moved(scenario.name, seed) if moved is None else moved
    rng = np.random.default_rng([seed, zlib.crc32(scenario.name.encode()), 3])
    cut = [pieces(run.recording, rng, length) for run in visits(scenario, seed, moved)]
    (first, bent_first), (second, bent_second) = cut
    taken: dict[str, list[tuple[int, int]]] = {}
    shares = {}
    couples = list(product(range(len(first)), range(len(second))))
    for i, j in (couples[k] for k in rng.permutation(len(couples))):
        shares[i, j] = shared(first[i], second[j])
        where = bin_of(shares[i, j][1], scenario.name)
        if where is None:
            continue
        before = taken.setdefault(where, [])
        if len(before) < quota and all(i != k and j != m for k, m in before):  # no stretch twice in a bin
            before.append((i, j))
    pairs = [
        _pair(scenario.name, seed, where, first[i], second[j], shares[i, j], moved)
        for where, chosen in taken.items()
        for i, j in chosen
    ]
    return Harvest(
        tuple(pairs), len(first) + len(second) + bent_first + bent_second, bent_first + bent_second
    )


def bins_of(scenario: str) -> tuple[str, ...]:
    """The bins that a scenario's pairs may be in."""
    return (TWINS,) if scenario == TWIN_SCENARIO else (*BINS, NONE)


def bin_of(overlap: float, scenario: str) -> str | None:
    """The bin of a pair, None where it lies between two."""
    if scenario == TWIN_SCENARIO:
        return TWINS
    if overlap == 0.0:
        return NONE
    return next((name for name, (low, high) in BINS.items() if low <= overlap < high), None)


def shared(a: Piece, b: Piece) -> tuple[np.ndarray, float]:
    """World cells ``(n, 2)`` that both have seen, and their share of those of the one that has seen less."""
    both = _keys(a.known)[np.isin(_keys(a.known), _keys(b.known), assume_unique=True)]
    cells = np.stack([both % SPAN - SPAN // 2, both // SPAN - SPAN // 2], -1)
    return cells, len(both) / min(len(a.known), len(b.known))


SPAN = 1 << 20


def _keys(cells: np.ndarray) -> np.ndarray:
    return (cells[:, 1] + SPAN // 2) * SPAN + cells[:, 0] + SPAN // 2


def _pair(
    scenario: str, seed: int, where: str, a: Piece, b: Piece, both: tuple[np.ndarray, float], moved: bool
) -> Pair:
    cells, overlap = both
    if len(cells):
        middle = (cells.mean(axis=0) + 0.5) * CELL
        T_world_a, T_world_b = frame_near(a, middle), frame_near(b, middle)
    else:
        middle, T_world_a, T_world_b = b.middles.mean(axis=0), a.T_world_map[0], b.T_world_map[0]
    middle_b = se2.transform(se2.inverse(T_world_b), middle[None])[0]
    T_a_b = se2.between(T_world_a, T_world_b)
    held = hold(a.submap, b.submap, T_a_b) if len(cells) else 0.0
    return Pair(scenario, seed, where, a.submap, b.submap, T_a_b, middle_b, overlap, moved, held)


def frame_near(piece: Piece, place: Array) -> Array:
    """Where a piece's frame lies in the world ``(3,)``, as its scans of the neighbourhood of a place say."""
    distance = np.linalg.norm(piece.middles - place, axis=1)
    weights = 1.0 / (1.0 + (distance / NEIGHBOURHOOD) ** 4)
    weights = weights / weights.sum()
    yaw = float(
        np.arctan2(weights @ np.sin(piece.T_world_map[:, 2]), weights @ np.cos(piece.T_world_map[:, 2]))
    )
    local = weights @ se2.transform(se2.inverse(piece.T_world_map), place[None])[:, 0]
    return np.array([*(place - se2.rotation(yaw) @ local), yaw])
