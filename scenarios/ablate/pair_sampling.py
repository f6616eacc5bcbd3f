"""Pairs of submaps from two recordings of one building, by how much of what they saw is the same."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from scipy.spatial import cKDTree

from scenarios.ablate.map_fragments import CELL, LENGTH, MapFragment, cut_fragments, record_two_sessions
from scenarios.ablate.trial_io import name_hash, stream
from scenarios.catalogue import CATALOGUE
from slam import se2
from slam.mapping.submap import Submap
from slam.se2 import Array
from stitch.alignment.raster import walls_of

BINS: dict[str, tuple[float, float]] = {
    "15 %": (0.10, 0.20),
    "30 %": (0.25, 0.35),
    "50 %": (0.42, 0.58),
    "80 %": (0.70, 0.90),
}
"""True overlap from (inclusive) and to (exclusive), as a share of the smaller map's known area."""
NONE, TWINS, STRANGERS = "none", "twins", "strangers"
"""Pairs that share nothing; of rows of identical rooms, however they overlap; of two buildings, to learn."""
ALL_BINS = (*BINS, NONE, TWINS)
TWIN_SCENARIO = "twin_rooms"
NEIGHBOURHOOD = 4.0
"""Scans whose points are centred more than this from the overlap [m] are down-weighted."""
PER_BUILDING, PER_TWIN_BUILDING = 5, 10
"""Most pairs of one bin from two recordings of one building; of twins there is only one scenario."""
WALL_CELL = 0.1
"""Side of the cells [m] in which walls are compared, one point in each."""
SAME_WALL_DISTANCE = 0.2
"""Walls within this [m] that face the same way are the same."""
SAME_WAY = 0.3
"""Least cosine between the normals of walls that face the same way."""
CELL_NUMBER = np.array([1, 1 << 20])
"""Makes one number of a cell's two; the world has fewer cells on each side."""


@dataclass(frozen=True)
class SubmapPair:
    """Two submaps and the truth about them.

    ``T_a_b (3,)`` is the true pose of b's frame in a's, as both maps are drawn where they overlap (a bent map
    has another one elsewhere); ``middle_b (2,)``: the middle of the overlap in b's frame, where errors are
    measured; ``overlap``: cells that both have seen, as a share of the smaller map's; ``moved``: furniture
    was moved between the recordings; ``hold``: metres of shared wall that constrain the worst constrained
    direction (`translational_constraint`).
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
class PairSample:
    """The pairs of one building, and how many fragments were cut and left out as bent."""

    pairs: tuple[SubmapPair, ...]
    stretches: int
    bent: int


def furniture_is_moved(scenario: str, seed: int) -> bool:
    """Whether furniture is moved between the two recordings of a building: in every third."""
    return (seed + name_hash(scenario)) % 3 == 0


def sample_pairs(
    scenario: str,
    seed: int,
    most: int,
    length: tuple[float, float] = LENGTH,
    moved: bool | None = None,
) -> PairSample:
    """Pairs from two recordings of a building of the catalogue, where a bin takes ``most``.

    ``length``: distance driven for the shortest and the longest fragment [m]. ``moved`` furniture where
    `furniture_is_moved` unless it is given.
    """
    moved = furniture_is_moved(scenario, seed) if moved is None else moved
    rng, quota = stream(seed, scenario, "pairs"), quota_of(scenario, most)
    sessions = record_two_sessions(CATALOGUE[scenario], seed, moved)
    (first, bent_first), (second, bent_second) = [
        cut_fragments(run.recording, rng, length) for run in sessions
    ]
    taken: dict[str, list[tuple[int, int]]] = {}
    overlaps = {}
    couples = list(product(range(len(first)), range(len(second))))
    for i, j in (couples[k] for k in rng.permutation(len(couples))):
        overlaps[i, j] = overlap_of(first[i], second[j])
        name = bin_of(overlaps[i, j][1], scenario)
        if name is None:
            continue
        before = taken.setdefault(name, [])
        if len(before) < quota and all(i != k and j != m for k, m in before):  # no fragment twice in a bin
            before.append((i, j))
    pairs = [
        _pair((scenario, seed, name), first[i], second[j], *overlaps[i, j], moved)
        for name, chosen in taken.items()
        for i, j in chosen
    ]
    bent = bent_first + bent_second
    return PairSample(tuple(pairs), len(first) + len(second) + bent, bent)


def quota_of(scenario: str, most: int) -> int:
    """Most pairs of a bin from one building, where a bin takes ``most``."""
    return min(PER_TWIN_BUILDING if scenario == TWIN_SCENARIO else PER_BUILDING, most)


def training_pairs(
    scenario: str, seed: int, length: tuple[float, float] = LENGTH
) -> tuple[tuple[SubmapPair, ...], tuple[SubmapPair, ...]]:
    """The pairs of a building to learn from: the study's, and those with moved furniture where the study has
    none, so that the hardest cases are learnt from most."""
    pairs = sample_pairs(scenario, seed, PER_TWIN_BUILDING, length).pairs
    if furniture_is_moved(scenario, seed):
        return pairs, ()
    return pairs, sample_pairs(scenario, seed, PER_TWIN_BUILDING, length, moved=True).pairs


def negative_pairs(pairs: Sequence[SubmapPair], others: Sequence[SubmapPair]) -> list[SubmapPair]:
    """The first map of each of ``pairs`` with the second of one of ``others``, of another building."""
    return [
        replace(pair, bin=STRANGERS, b=other.b, middle_b=other.middle_b, overlap=0.0)
        for pair, other in zip(pairs, others, strict=False)
    ]


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


def overlap_of(a: MapFragment, b: MapFragment) -> tuple[np.ndarray, float]:
    """World cells ``(n, 2)`` that both have seen, and their share of those of the one that has seen less."""
    cells = a.known[np.isin(a.known @ CELL_NUMBER, b.known @ CELL_NUMBER, assume_unique=True)]
    return cells, len(cells) / min(len(a.known), len(b.known))


def _pair(
    about: tuple[str, int, str], a: MapFragment, b: MapFragment, cells: np.ndarray, share: float, moved: bool
) -> SubmapPair:
    if len(cells):
        middle = (cells.mean(axis=0) + 0.5) * CELL
        T_world_a, T_world_b = frame_near(a, middle), frame_near(b, middle)
    else:
        middle, T_world_a, T_world_b = b.middles.mean(axis=0), a.T_world_map[0], b.T_world_map[0]
    middle_b = se2.transform(se2.inverse(T_world_b), middle[None])[0]
    T_a_b = se2.between(T_world_a, T_world_b)
    hold = translational_constraint(a.submap, b.submap, T_a_b) if len(cells) else 0.0
    return SubmapPair(*about, a.submap, b.submap, T_a_b, middle_b, share, moved, hold)


def frame_near(fragment: MapFragment, place: Array) -> Array:
    """Pose ``(3,)`` of a fragment's frame in the world, as its scans near ``place (2,)`` m have it."""
    distance = np.linalg.norm(fragment.middles - place, axis=1)
    weights = 1.0 / (1.0 + (distance / NEIGHBOURHOOD) ** 4)
    weights = weights / weights.sum()
    frames = fragment.T_world_map
    yaw = float(np.arctan2(weights @ np.sin(frames[:, 2]), weights @ np.cos(frames[:, 2])))
    local = weights @ se2.transform(se2.inverse(frames), place[None])[:, 0]
    return np.array([*(place - se2.rotation(yaw) @ local), yaw])


def translational_constraint(a: Submap, b: Submap, T_a_b: Array) -> float:
    """Metres of shared wall that constrain the worst constrained direction of b at ``T_a_b (3,)`` in a.

    The smaller eigenvalue of the sum of n nᵀ over the shared wall cells, n their unit normals, times the
    cell: the translation's information of Censi (2007) for points without noise. 0 where nothing is shared.
    """
    walls_a, walls_b = walls_of(a, WALL_CELL), walls_of(b, WALL_CELL)
    if len(walls_a.points) == 0 or len(walls_b.points) == 0:
        return 0.0
    points, facing = se2.transform(T_a_b, walls_b.points), walls_b.facing @ se2.rotation(T_a_b[2]).T
    distance, nearest = cKDTree(walls_a.points).query(points)
    alike = np.sum(facing * walls_a.facing[nearest], axis=1) > SAME_WAY
    shared = (distance < SAME_WALL_DISTANCE) & alike
    points, facing = points[shared], facing[shared]
    _, first = np.unique(np.floor(points / WALL_CELL), axis=0, return_index=True)
    normals = facing[first] / np.linalg.norm(facing[first], axis=1, keepdims=True)
    return float(max(np.linalg.eigvalsh(normals.T @ normals)[0], 0.0)) * WALL_CELL
