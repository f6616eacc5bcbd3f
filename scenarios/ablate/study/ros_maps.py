"""ROS maps as people published them: each with itself, pairs of one place, pairs of different places."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from itertools import combinations_with_replacement
from pathlib import Path

import numpy as np

from scenarios.ablate.options import RosMapsOptions
from scenarios.ablate.study.stitching import PRIOR_SIGMA, score_alignment
from scenarios.ablate.trial_io import stream
from scenarios.jsonable import jsonable
from scenarios.options import parse_names
from scenarios.stages import timed
from slam import se2
from slam.cli import InputError
from slam.formats import FormatError
from slam.mapping.submap import Submap
from slam.se2 import Array
from slam.table import Table, number
from stitch.align import NoStitch, Stitch, align
from stitch.command.maps import between_maps, prior_between, read_submap, settings_for

LIMIT = (0.3, np.radians(3.0))
"""An answer is right within this (m at the middle of the smaller map's walls, rad): the maps are bent …"""
BENT = {"corridor_growing": np.radians(1.0)}
"""… and those of some places by so much [rad] as a whole, as the README of the data says: the middle of a map
that starts where the other does is then off by that times its distance from the start."""
T_CARTOGRAPHER_OTHERS = np.array([1.43, 0.23, 0.0])
"""Where maps of the other systems lie in one of cartographer's, of the exam."""
ONE_WORLD = ("map_circular", "tb3_sandbox", "turtlebot3_map")
"""Of ``single``, where else every map is a place of its own; their world all but repeats itself turned."""
ITSELF, ONE_PLACE, WITH_PRIOR, DIFFERENT = (
    "itself",
    "one place",
    "one place, with a prior",
    "different places",
)
KINDS = (ITSELF, ONE_PLACE, WITH_PRIOR, DIFFERENT)


@dataclass(frozen=True)
class PublishedMap:
    """A map, its place, and the pose ``T_place_map (3,)`` of its frame in that of the place."""

    name: str
    place: str
    T_place_map: Array
    submap: Submap = field(repr=False)

    @property
    def middle(self) -> Array:
        """The middle ``(2,)`` m of its walls, in the map's frame."""
        return se2.transform(self.submap.anchor, self.submap.grid.occupied_points().mean(axis=0)[None])[0]


@dataclass(frozen=True)
class PairResult:
    """What became of map ``b`` in map ``a``; NaN errors where it was refused or there is no truth."""

    kind: str
    place: str
    a: str
    b: str
    outcome: str
    error_m: float
    error_deg: float
    belief: float
    seconds: float
    reason: str


def run(options: RosMapsOptions) -> None:
    """Join all pairs and print what became of them."""
    folder = options.data / "ros_maps"
    if not folder.is_dir():
        print(f"skipped: {folder} is absent", file=sys.stderr)
        return
    maps, unread = read_maps(folder, options.places)
    for line in unread:
        print(f"not read: {line}", file=sys.stderr)
    results = list(join_all(maps))
    if options.format == "json":
        print(json.dumps(jsonable({"schema": 1, "study": "ros_maps", "pairs": results}), indent=2))
        return
    pairs_table(
        [result for result in results if result.kind != DIFFERENT or result.outcome != "refused"]
    ).print()
    summary(results).print()


def read_maps(folder: Path, places: str = "") -> tuple[list[PublishedMap], list[str]]:
    """The maps of some subfolders, and a line for each that cannot be read. Raises `InputError`."""
    there = {path.name: path for path in sorted(folder.iterdir()) if path.is_dir()}
    chosen = parse_names(places, there, "place") if places else list(there)
    maps, unread = [], []
    for file in [file for name in chosen for file in sorted(there[name].glob("*.yaml"))]:
        try:
            submap, _ = read_submap(file)
        except FormatError as error:
            unread.append(str(error))
            continue
        maps.append(PublishedMap(file.stem, *frame(file, submap.anchor), submap))
    if not maps:
        raise InputError(f"{folder}: expected folders with maps, NAME.yaml each")
    return maps, unread


def frame(file: Path, corner: Array) -> tuple[str, Array]:
    """The place of a map and the pose ``(3,)`` of its frame there, by the start frames that are known."""
    place = file.parent.name
    if place == "single":
        return (place if file.stem in ONE_WORLD else file.stem), np.zeros(3)
    if place == "exam" and "cartographer" not in file.stem:
        return place, T_CARTOGRAPHER_OTHERS
    if place == "hospital":  # the merger laid the pictures corner on corner
        return place, np.array([*-corner[:2], 0.0])
    return place, np.zeros(3)


def join_all(maps: list[PublishedMap]) -> Iterator[PairResult]:
    """The results of every pair, a map with itself first; those of one place once more with a prior."""
    for a, b in combinations_with_replacement(maps, 2):
        kind = ITSELF if a is b else ONE_PLACE if a.place == b.place else DIFFERENT
        yield join(a, b, kind)
        if kind == ONE_PLACE:
            yield join(a, b, WITH_PRIOR, stream(0, f"{a.name} {b.name}", "priors"))


def join(a: PublishedMap, b: PublishedMap, kind: str, rng: np.random.Generator | None = None) -> PairResult:
    """The result of one pair, with a prior whose error ``rng`` draws."""
    truth = se2.between(a.T_place_map, b.T_place_map)
    prior = None
    if rng is not None:
        guess = se2.compose(truth, PRIOR_SIGMA * rng.standard_normal(3))
        prior = prior_between(a.submap, b.submap, guess, PRIOR_SIGMA)
    settings = settings_for([a.submap, b.submap])
    anchored, seconds = timed(align, a.submap, b.submap, prior, settings)
    reason = anchored.reason if isinstance(anchored, NoStitch) else ""
    result = between_maps(a.submap, b.submap, anchored)
    smaller_a = len(a.submap.points) < len(b.submap.points)
    middle = se2.transform(se2.inverse(truth), a.middle[None])[0] if smaller_a else b.middle
    reach = BENT.get(b.place, 0.0) * float(np.linalg.norm(middle))
    limit = LIMIT[0] + reach, LIMIT[1]
    outcome, error, _ = score_alignment(bent_at(result, middle), truth, middle, limit)
    if kind == DIFFERENT:
        outcome, error = ("refused" if isinstance(result, NoStitch) else "false"), (np.nan, np.nan)
    belief = np.nan if isinstance(result, NoStitch) or result.belief is None else result.belief
    place = a.place if kind != DIFFERENT else f"{a.place}, {b.place}"
    return PairResult(kind, place, a.name, b.name, outcome, *error, belief, seconds, reason)


def bent_at(result: Stitch | NoStitch, middle_b: Array) -> Stitch | NoStitch:
    """A bent answer as the rigid one that puts b's point ``middle_b (2,)`` m where the bend does."""
    if isinstance(result, NoStitch) or result.bend is None:
        return result
    off = result.bend.apply(middle_b[None])[0] - se2.transform(result.T_a_b, middle_b[None])[0]
    return replace(result, T_a_b=result.T_a_b + np.array([*off, 0.0]))


def pairs_table(results: list[PairResult]) -> Table:
    """A row per pair."""
    columns = ("kind", "place", "a", "b", "outcome", "reason", "error [m]", "error [°]", "log-odds")
    rows = []
    for r in sorted(results, key=lambda r: (KINDS.index(r.kind), r.place)):
        errors = number(r.error_m, 3), number(r.error_deg, 2), number(r.belief, 1)
        rows.append((r.kind, r.place, r.a, r.b, r.outcome, r.reason, *errors))
    return Table(columns, rows, "Published ROS maps, pair by pair", names=6).grouped(2)


def summary(results: list[PairResult]) -> Table:
    """How many are right, false and refused, by kind and place; different places all together."""
    groups: dict[tuple[str, str], list[PairResult]] = {}
    for kind in KINDS:
        for result in [result for result in results if result.kind == kind]:
            for place in {"all", result.place} if kind != DIFFERENT else {"all"}:
                groups.setdefault((kind, place), []).append(result)
    rows = [(*key, *counts(group).values()) for key, group in sorted(groups.items(), key=_order)]
    return Table(("kind", "place", *counts([])), rows, "Published ROS maps", names=2).grouped()


def _order(item: tuple[tuple[str, str], list[PairResult]]) -> tuple[int, bool, str]:
    (kind, place), _ = item
    return KINDS.index(kind), place == "all", place


def counts(results: list[PairResult]) -> Mapping[str, str]:
    """Numbers of pairs by what became of them."""
    outcomes = [result.outcome for result in results]
    ambiguous = [result.reason.startswith("ambiguity") for result in results if result.outcome == "refused"]
    return {
        "pairs": str(len(outcomes)),
        "right": str(outcomes.count("right")),
        "false": str(outcomes.count("false")),
        "refused": str(outcomes.count("refused")),
        "of these ambiguous": str(sum(ambiguous)),
    }
