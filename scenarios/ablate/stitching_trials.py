"""The trials of the stitching study: the pairs of a building, and one aligner's results for them."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from typing import Literal

import numpy as np

from scenarios.ablate.pair_sampling import PairSample, SubmapPair, bins_of, quota_of
from scenarios.ablate.random_streams import stream
from scenarios.sweep import Answer, Failure, SweepResult, Trial
from slam import se2
from slam.mapping.occupancy import Grid
from slam.mapping.submap import Submap
from slam.se2 import Array
from stitch.align import AlignConfig, NoStitch, Prior, Stitch, align

Outcome = Literal["right", "false", "refused"]

PAIRS = "pairs"
"""The trial of a building that lists its pairs; the others align them."""
LIMIT = (0.3, np.radians(2.0))
"""An alignment is right within this (m at the middle of the overlap, rad)."""
PRIOR_SIGMA = np.array([1.0, 1.0, np.radians(10.0)])
"""Standard deviation of the prior (m, m, rad); its error is drawn from it."""
WITH_PRIOR = ("joint",)
"""Methods that are measured with a prior as well: of the others only Formsma's reads a part of it."""


@dataclass(frozen=True)
class AlignerVariant:
    """A method as it is measured: by name, with or without a prior."""

    method: str
    prior: bool

    @property
    def name(self) -> str:
        """How tables call it."""
        return f"{self.method} + prior" if self.prior else self.method


@dataclass(frozen=True)
class AlignmentRow:
    """One method on one pair: errors are NaN where it was refused, ``nees`` where it has no covariance."""

    variant: str
    scenario: str
    seed: int
    bin: str
    overlap: float
    moved: bool
    hold: float
    outcome: Outcome
    error_m: float
    error_deg: float
    nees: float
    seconds: float
    reason: str


@dataclass(frozen=True)
class BuildingResult:
    """The rows of one building, pair by pair, how many of its fragments were bent, and the sizes of its
    pairs' maps by `map_size`."""

    rows: tuple[AlignmentRow, ...]
    stretches: int
    bent: int
    sizes: tuple[tuple[float, float], ...]


class BinCounts:
    """How many pairs each bin has, of the ``most`` that it takes."""

    def __init__(self, most: int) -> None:
        self.most = most
        self.counts: Counter[str] = Counter()

    def is_open(self, scenario: str) -> bool:
        """Whether a building of the scenario may still help to fill a bin."""
        return any(self.counts[name] < self.most for name in bins_of(scenario))

    def put(self, name: str) -> bool:
        """Count a pair; False where its bin is full."""
        if self.counts[name] >= self.most:
            return False
        self.counts[name] += 1
        return True

    def take(self, trial: Trial, result: Answer | Failure) -> None:
        """Count the pairs of a building as soon as they are known."""
        if trial.method == PAIRS and isinstance(result, Answer):
            for name in result.rows[0]["bins"]:
                self.put(name)


def trials(
    buildings: Sequence[tuple[str, int]], methods: Sequence[str], bins: BinCounts, length: tuple[float, float]
) -> Iterator[Trial]:
    """For every building (scenario, seed) that may help to fill a bin when its turn comes: its pairs, and
    every method's results, with a prior as well where it is `WITH_PRIOR`.

    ``length``: distance driven for the shortest and the longest submap [m].
    """
    for scenario, seed in buildings:
        if not bins.is_open(scenario):
            continue
        settings = {"quota": quota_of(scenario, bins.most), "length": list(length)}
        yield Trial("stitching", scenario, seed, PAIRS, settings)
        for method in methods:
            for prior in (False, True) if method in WITH_PRIOR else (False,):
                about = settings | {"method": method, "prior": prior}
                yield Trial("stitching", scenario, seed, AlignerVariant(method, prior).name, about)


def run_trial(trial: Trial, sample: PairSample) -> Answer:
    """One row that counts the pairs of a building, or a method's rows for them."""
    if trial.method == PAIRS:
        sizes = [map_size(submap.grid) for pair in sample.pairs for submap in (pair.a, pair.b)]
        bins = [pair.bin for pair in sample.pairs]
        return Answer([{"bins": bins, "stretches": sample.stretches, "bent": sample.bent, "sizes": sizes}])
    variant = AlignerVariant(trial.config["method"], trial.config["prior"])
    return Answer([asdict(row) for row in align_pairs(sample.pairs, variant)])


def align_pairs(pairs: Sequence[SubmapPair], variant: AlignerVariant) -> list[AlignmentRow]:
    """A method's row for each pair; the error of its prior is the pair's own."""
    config = AlignConfig(method=variant.method)
    if pairs:
        align(pairs[0].a, pairs[0].b, None, config)  # load its kernels before its time is taken
    rows = []
    for k, pair in enumerate(pairs):
        prior = (
            draw_prior(pair.T_a_b, stream(pair.seed, pair.scenario, "priors", k)) if variant.prior else None
        )
        result, seconds, reason = timed_align(pair.a, pair.b, prior, config)
        outcome, error, nees = score_alignment(result, pair.T_a_b, pair.middle_b)
        about = pair.scenario, pair.seed, pair.bin, pair.overlap, pair.moved, pair.hold
        rows.append(AlignmentRow(variant.name, *about, outcome, *error, nees, seconds, reason))
    return rows


def timed_align(
    a: Submap, b: Submap, prior: Prior | None, config: AlignConfig
) -> tuple[Stitch | NoStitch, float, str]:
    """The alignment, its processor time [s], and the reason where it was refused."""
    started = time.process_time()
    result = align(a, b, prior, config)
    seconds = time.process_time() - started
    return result, seconds, result.reason if isinstance(result, NoStitch) else ""


def draw_prior(T_a_b: Array, rng: np.random.Generator) -> Prior:
    """A prior of `PRIOR_SIGMA` whose error is as large as it says."""
    return Prior(se2.compose(T_a_b, PRIOR_SIGMA * rng.standard_normal(3)), np.diag(PRIOR_SIGMA**2))


def score_alignment(
    result: Stitch | NoStitch, T_a_b: Array, middle_b: Array, limit: tuple[float, float] = LIMIT
) -> tuple[Outcome, tuple[float, float], float]:
    """Outcome, error (m at b's point ``middle_b (2,)``, degrees) and squared Mahalanobis error."""
    if isinstance(result, NoStitch):
        return "refused", (np.nan, np.nan), np.nan
    distance, angle = pose_error(result.T_a_b, T_a_b, middle_b)
    nees = np.nan
    if result.covariance is not None:
        xi = se2.log(se2.between(T_a_b, result.T_a_b))
        nees = float(xi @ np.linalg.solve(result.covariance, xi))
    outcome: Outcome = "right" if is_right(result.T_a_b, T_a_b, middle_b, limit) else "false"
    return outcome, (distance, float(np.degrees(angle))), nees


def pose_error(T_a_b: Array, truth: Array, middle_b: Array) -> tuple[float, float]:
    """Distance of two poses ``(3,)`` of b in a from each other: m at b's point ``middle_b (2,)``, rad."""
    moved = se2.transform(T_a_b, middle_b[None]) - se2.transform(truth, middle_b[None])
    return float(np.linalg.norm(moved)), abs(float(se2.wrap(T_a_b[2] - truth[2])))


def is_right(T_a_b: Array, truth: Array, middle_b: Array, limit: tuple[float, float] = LIMIT) -> bool:
    """Whether a pose ``(3,)`` of b in a is within ``limit`` (m, rad) of the truth."""
    distance, angle = pose_error(T_a_b, truth, middle_b)
    return distance <= limit[0] and angle <= limit[1]


def map_size(grid: Grid) -> tuple[float, float]:
    """Longer and shorter side [m] of the smallest rectangle, however turned, round the known cells."""
    import cv2

    known = np.argwhere(grid.occupied | grid.free).astype(np.float32)
    _, sides, _ = cv2.minAreaRect(known)
    long, short = sorted([(side + 1.0) * grid.resolution for side in sides], reverse=True)
    return long, short


def truncate_to_quota(swept: SweepResult, most: int) -> list[BuildingResult]:
    """Results of the buildings that helped to fill a bin, in their order, without the pairs beyond ``most``
    in a bin: they do not depend on how many surplus pairs parallel workers computed."""
    bins, results = BinCounts(most), list[BuildingResult]()
    by_building: dict[tuple[str, int], list[Answer]] = {}
    for trial, result in swept.answered:
        if trial.method == PAIRS or trial.drive in by_building:
            by_building.setdefault(trial.drive, []).append(result)
    for listed, *aligned in by_building.values():
        (about,) = listed.rows
        kept = [k for k, name in enumerate(about["bins"]) if bins.put(name)]
        rows = tuple(AlignmentRow(**result.rows[k]) for k in kept for result in aligned)
        if rows:
            sizes = tuple((long, short) for k in kept for long, short in about["sizes"][2 * k : 2 * k + 2])
            results.append(BuildingResult(rows, about["stretches"], about["bent"], sizes))
    return results
