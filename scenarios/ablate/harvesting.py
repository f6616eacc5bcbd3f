"""The trials of the stitching study: pairs of submaps of one building, and one method's answers to them."""

from __future__ import annotations

import zlib
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass

import numpy as np

from scenarios.ablate.pairs import TWIN_SCENARIO, Harvest, Pair, bins_of, harvest, is_moved
from scenarios.ablate.pieces import LENGTH
from scenarios.ablate.study.stitching import PER_BUILDING, PER_TWIN_BUILDING, WITH_PRIOR
from scenarios.ablate.trial import Row, Variant, attempt
from scenarios.catalogue import CATALOGUE
from scenarios.sweep import Answer, Failure, Swept, Trial
from slam.mapping.occupancy import Grid
from stitch.align import AlignConfig, align

PAIRS = "pairs"
"""The trial that tells which pairs there are; the others answer them."""


class Bins:
    """How many pairs each bin has, of the ``most`` that it takes."""

    def __init__(self, most: int) -> None:
        self.most = most
        self.counts: Counter[str] = Counter()

    def is_open(self, scenario: str) -> bool:
        """Whether a building of the scenario may still help to fill one."""
        return any(self.counts[where] < self.most for where in bins_of(scenario))

    def put(self, where: str) -> bool:
        """Put a pair into its bin; False where that is full."""
        if self.counts[where] >= self.most:
            return False
        self.counts[where] += 1
        return True

    def take(self, trial: Trial, found: Answer | Failure) -> None:
        """Put the pairs of a building into their bins as soon as they are known."""
        if trial.method == PAIRS and isinstance(found, Answer):
            for where in found.rows[0]["bins"]:
                self.put(where)


@dataclass(frozen=True)
class Report:
    """The rows for one building, pair by pair, how many of its stretches were bent, and the sizes of its
    pairs' maps as of `size`."""

    rows: tuple[Row, ...]
    stretches: int
    bent: int
    sizes: tuple[tuple[float, float], ...]


def trials(
    buildings: Sequence[tuple[str, int]], methods: Sequence[str], bins: Bins, length: tuple[float, float]
) -> Iterator[Trial]:
    """For every building (scenario, seed) that may help to fill a bin when its turn comes: its pairs, and
    the answers of every method, with a prior as well where it is `WITH_PRIOR`.

    ``length``: of the shortest and the longest stretch of a drive [m] that is a submap.
    """
    for scenario, seed in buildings:
        if not bins.is_open(scenario):
            continue
        settings = {"quota": quota(scenario, bins.most), "length": list(length)}
        yield Trial("stitching", scenario, seed, PAIRS, settings)
        for method in methods:
            for prior in (False, True) if method in WITH_PRIOR else (False,):
                asked = settings | {"method": method, "prior": prior}
                yield Trial("stitching", scenario, seed, Variant(method, prior).name, asked)


def quota(scenario: str, most: int) -> int:
    """Most pairs of a bin from one building, where a bin takes so many."""
    return min(PER_TWIN_BUILDING if scenario == TWIN_SCENARIO else PER_BUILDING, most)


def harvested(scenario: str, seed: int, most: int, length: tuple[float, float] = LENGTH) -> Harvest:
    """The pairs of a building."""
    return harvest(CATALOGUE[scenario], seed, quota(scenario, most), length)


def both_ways(
    scenario: str, seed: int, length: tuple[float, float] = LENGTH
) -> tuple[tuple[Pair, ...], tuple[Pair, ...]]:
    """The pairs of a building to learn from: the study's, and those there are once furniture is moved, where
    in the study it is not: what is hardest to tell is learnt from most."""
    most = quota(scenario, PER_TWIN_BUILDING)
    found = harvest(CATALOGUE[scenario], seed, most, length).pairs
    if is_moved(scenario, seed):
        return found, ()
    return found, harvest(CATALOGUE[scenario], seed, most, length, moved=True).pairs


def answer(trial: Trial, found: Harvest) -> Answer:
    """One row that counts the pairs of a building, or a method's rows for them."""
    if trial.method == PAIRS:
        bins = [pair.bin for pair in found.pairs]
        about = {"bins": bins, "stretches": found.stretches, "bent": found.bent}
        return Answer(
            [about | {"sizes": [size(map_.grid) for pair in found.pairs for map_ in (pair.a, pair.b)]}]
        )
    variant = Variant(trial.config["method"], trial.config["prior"])
    return Answer([asdict(row) for row in rows_of(found.pairs, variant)])


def size(grid: Grid) -> tuple[float, float]:
    """Longer and shorter side [m] of the smallest rectangle, however turned, round what a map has seen."""
    import cv2

    known = np.argwhere(grid.occupied | grid.free).astype(np.float32)
    _, sides, _ = cv2.minAreaRect(known)
    long, short = sorted([(side + 1.0) * grid.resolution for side in sides], reverse=True)
    return long, short


def rows_of(pairs: Sequence[Pair], variant: Variant) -> list[Row]:
    """A method's row for each pair; the error of its prior is the pair's own."""
    config = AlignConfig(method=variant.method)
    rows = []
    for k, pair in enumerate(pairs):
        if k == 0:
            align(pair.a, pair.b, None, config)  # load its kernels before its time is taken
        rng = np.random.default_rng([pair.seed, zlib.crc32(pair.scenario.encode()), 4, k])
        rows.append(attempt(pair, variant, config, rng))
    return rows


def kept(swept: Swept, most: int) -> list[Report]:
    """Reports of the buildings that helped to fill a bin, in their order; pairs beyond are left out.

    It does not matter how far ahead of a full bin the sweep was.
    """
    bins, reports = Bins(most), list[Report]()
    answered: dict[tuple[str, int], list[Answer]] = {}
    for trial, found in swept.answered:
        answered.setdefault(trial.drive, []).append(found)
    known = [(trial.drive, found) for trial, found in swept.answered if trial.method == PAIRS]
    for building, counted in known:
        (about,) = counted.rows
        numbers = [k for k, where in enumerate(about["bins"]) if bins.put(where)]
        answers = answered[building][1:]
        rows = tuple(Row(**found.rows[k]) for k in numbers for found in answers)
        if rows:
            sizes = tuple((long, short) for k in numbers for long, short in about["sizes"][2 * k : 2 * k + 2])
            reports.append(Report(rows, about["stretches"], about["bent"], sizes))
    return reports
